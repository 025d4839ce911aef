// Several images of one material tell more than one.
//
// Each answer is a Gaussian over the material's coordinates (of a mixture the one with its mean and
// covariance): what its image says, times what was
// known before, the distribution of the training materials. So the answer from all is the product
// of the Gaussians over the power of the prior that is in it too often:
//
//   precision    L = P + c sum_i (L_i - P),    c = 1 / (1 + (n - 1) r)
//   information  h = P p_1 + c sum_i (h_i - P p_i)
//
// with precision P and mean p_i of the prior, which is the Gaussian that has the means and
// covariances of the training materials' coordinates (Model.correlation). If the errors in two
// images of one object had nothing in common, c would be 1. They have, since the network
// misunderstands a shape in the same way twice: r is their correlation (Model.error_correlation),
// and n images tell as much as n c would.
//
// That is done along the principal axes of the mean answer's precision relative to P. Along one in
// which the answers are no surer than the prior, the prior is not taken out: the mean answer stays.
// Along the others L is as above, but the mean goes no farther from p than answers to a Gaussian
// prior do (two standard deviations of their means), unless the mean answer is farther itself.
#pragma once

#include <span>
#include <vector>

#include "common/learning/gaussian.h"
#include "common/learning/parameterization.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// In standardised coordinates: the outputs for one image, and the object's longest side in mm. The
// first coordinate of each channel is a logarithm of something per length, so that another size
// moves those alone.
struct ImageAnswer {
  std::vector<double> outputs;
  double object_size = 1;
};

class Combination {
 public:
  // Throws Error (invalid input) unless the model answers distributions, and says what its training
  // materials were.
  explicit Combination(const v1::Model& model);

  // Outputs for an object as large as the first one's. One answer alone stays what it is. Requires
  // one at least.
  std::vector<double> operator()(std::span<const ImageAnswer> answers) const;

 private:
  double error_correlation_;
  std::vector<double> log_size_units_;  // standard deviation of the first coordinate, by channel
  Gaussian prior_;
};

}  // namespace itn
