// What is said of a refined material: intervals, and words where numbers do not do.
#pragma once

#include <span>

#include "client/refine/small_matrix.h"
#include "itn/v1/refine.pb.h"

namespace itn {

// The answer at these coordinates (client/refine/coordinates.h) with this covariance: material,
// parameters, correlations and remarks. Intervals are those of a Gaussian over the logarithms of
// what is positive, over the logit of the albedo, and over that of (1 + g) / 2.
v1::RefineResult answer_of(std::span<const double> coordinates, const SmallMatrix& covariance);

}  // namespace itn
