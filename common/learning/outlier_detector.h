// Whether a network knows images like this one. A network answers anything, and is as sure of an
// image such as it has never seen; so the model keeps what images of its training are like, and
// measures how far from them an image is (Lee et al., "A simple unified framework for detecting
// out-of-distribution samples", NeurIPS 2018), in five ways:
//
//   embedding    Mahalanobis distance of what the network's last layer sees of it
//   statistics   likewise, of the image itself, as a network overlooks what never varied while it
//                learned
//   range        the statistic that is farthest out, over the farthest of training images on the
//                same side: a Gaussian does not know that nothing outdoors is brighter than the sun
//                makes it
//   encoding     how much the statistics are those of an image that is encoded for a screen, the
//                most likely mistake, by Fisher's linear discriminant
//   disorder     likewise, how much they are those of an image whose pixels are in any order, as of
//                mere noise
//
// The score is the largest, each over its threshold: what one in 500 held-out images exceeds, so
// that 99 % of them are below 1 in all; without those in which noise hides nearly everything.
#pragma once

#include <string>
#include <vector>

#include <torch/types.h>

#include "common/learning/network_input.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// Logarithms, on the object, of: the mean luminance (0 where the exposure is unknown); quantiles of
// the luminance over its mean, from the 2 % to the 98 % one; differences to the neighbours over
// their mean, as median (noise) and root mean square, and the latter for neighbours 2 and 4 pixels
// away, if the object is wide enough; the area; and the part of it that is as bright as its
// brightest pixel, as where a photograph is overexposed. Finite for all images. images x count,
// double.
inline constexpr int64_t kImageStatistics = 14;
torch::Tensor image_statistics(const v1::Model& model, const ImageBatch& images);

// Features of some images.
struct Features {
  torch::Tensor embedding;   // images x embedding_size(), float
  torch::Tensor statistics;  // images x kImageStatistics, double
};

// The images as a screen would have them: by turns the brightest pixel stays as bright, or the
// mean. Relative noise becomes less as contrast does.
ImageBatch tone_mapped(const ImageBatch& images);

// The images with the pixels of each object in a random order, always the same one.
ImageBatch shuffled(const ImageBatch& images);

// Statistics of images after a change that proper images have not undergone: images x
// kImageStatistics.
struct CorruptedStatistics {
  torch::Tensor encoded, shuffled;
};

// From images of training, the same or others corrupted, and images of held-out shapes.
// Deterministic. Requires two images of each at least.
v1::OutlierModel fit_outlier_model(const Features& training, const CorruptedStatistics& corrupted,
                                   const Features& held_out);

// See v1::OutlierScore.
struct OutlierScore {
  double score = 0, rank = 0;
  bool is_outlier = false;
  std::string reason;
};

class OutlierDetector {
 public:
  // For embeddings of this size. Throws Error (invalid input) if the numbers do not make sense.
  OutlierDetector(const v1::OutlierModel& outlier_model, int64_t embedding_size);

  // One for each image.
  std::vector<OutlierScore> scores(const Features& images) const;

  // Each over its threshold: images, double.
  struct Distances {
    torch::Tensor embedding, statistics, range, encoding, disorder;

    torch::Tensor largest() const {
      return torch::stack({embedding, statistics, range, encoding, disorder}).amax(0);
    }
  };
  Distances distances(const Features& images) const;

 private:
  struct Gaussian {
    torch::Tensor mean, axes;  // double
    double rest, usual;
    torch::Tensor distance(const torch::Tensor& vectors) const;
  };
  static Gaussian read(const char* what, const v1::PrincipalGaussian& proto, int64_t size);
  // Tells where an image lies between the middle and the ends of what training images have.
  struct Range {
    torch::Tensor lowest, middle, highest;  // of each statistic, double
    double usual;
    torch::Tensor distance(const torch::Tensor& statistics) const;
  };
  static Range read(const v1::StatisticsRange& proto);
  // How far the images' statistics lie in this direction.
  torch::Tensor along(const torch::Tensor& direction, const Features& images) const;
  std::string unusual(const torch::Tensor& statistics) const;

  Gaussian embedding_, statistics_;
  Range range_;
  torch::Tensor encoding_, disorder_;  // directions
  torch::Tensor deviations_;           // standard deviations of the statistics
  std::vector<double> quantiles_;
};

}  // namespace itn
