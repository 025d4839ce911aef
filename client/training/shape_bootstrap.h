// Errors with their uncertainty. Images of one shape have much in common: what is drawn anew is
// shapes, with all of their images.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

namespace itn {

// With its 95 % interval.
struct Estimate {
  double value = 0;
  double low = 0, high = 0;
};

class ShapeBootstrap {
 public:
  // `shapes`: the shape of each image. The draws are the same every time, and for every statistic:
  // those of two networks can be compared draw by draw.
  explicit ShapeBootstrap(std::span<const std::string> shapes);

  size_t images() const { return group_.size(); }
  size_t shapes() const { return sizes_.size(); }

  // A function of the means over images of some terms. `terms`: of each kind one for each image.
  Estimate estimate(std::span<const std::vector<double>> terms,
                    const std::function<double(std::span<const double>)>& statistic) const;

  // sqrt of the mean of the squares, and the mean.
  Estimate root_mean_square(std::span<const double> errors) const;
  Estimate mean(std::span<const double> values) const;

 private:
  std::vector<size_t> group_;               // of each image
  std::vector<double> sizes_;               // of each group
  std::vector<std::vector<size_t>> draws_;  // groups
};

}  // namespace itn
