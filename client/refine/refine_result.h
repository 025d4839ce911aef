// What is said of a refined material: intervals, and words where numbers do not do.
#pragma once

#include <cstddef>

#include "client/refine/matrix.h"
#include "client/refine/region.h"
#include "itn/v1/refine.pb.h"

namespace itn {

// The answer in the midst of this region: material, parameters, correlations and remarks. A
// standard deviation is that of the Gaussian with the same 95 % interval, over the logarithms of
// what is positive, over the logit of the albedo, and over that of (1 + g) / 2.
v1::RefineResult refine_result(const Region& region, size_t colour = 0);

// Whether its intervals hold: it is no misfit, and did not end on its way.
inline bool has_intervals(const v1::RefineResult& result) {
  return !result.misfit() && !result.unfinished();
}

// Whether a number was so well known before that it was not found.
inline bool is_as_given(const v1::RefinedParameter& parameter) {
  constexpr double kGiven = 1e-3;
  return parameter.high_95() - parameter.low_95() < kGiven;
}

// Remarks on what the intervals leave open: nothing if they do not hold.
void add_remarks(v1::RefineResult& result);

// Standard deviations of ln sigma_t, albedo and g.
Eigen::Vector3d physical_deviations(const Region& region, size_t colour = 0);

}  // namespace itn
