// Distributions of one number, as dataset files have them.
#pragma once

#include <string>
#include <vector>

#include "itn/v1/dataset.pb.h"

namespace itn {

v1::Distribution fixed(double value);
v1::Distribution uniform(double min, double max);
v1::Distribution log_uniform(double min, double max);
v1::Distribution complement_log_uniform(double min, double max);

// Throws Error (invalid input) with the name unless all that can be drawn lies in [low, high].
void validate(const std::string& name, const v1::Distribution& distribution, double low,
              double high);

// The value at `u` in [0, 1) of a valid distribution: uniform numbers give the distribution.
double quantile(const v1::Distribution& distribution, double u);

// The density of an interval at `x`, without the factor that makes its integral 1.
double density(const v1::Distribution& distribution, double x);

// The least and the greatest value.
v1::Interval range_of(const v1::Distribution& distribution);

// Whether it is a list, or fixed; and its values then.
bool is_list(const v1::Distribution& distribution);
std::vector<double> values_of(const v1::Distribution& distribution);

}  // namespace itn
