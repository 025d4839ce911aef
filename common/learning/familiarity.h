// Whether a network knows images like this one. A network answers anything, and is as sure of an
// image such as it has never seen; so the model keeps what images of its training are like, and
// measures how far from them an image is (Lee et al., "A simple unified framework for detecting
// out-of-distribution samples", NeurIPS 2018), in three ways:
//
//   embedding    Mahalanobis distance of what the network's last layer sees of it
//   statistics   likewise, of the image itself, as a network overlooks what never varied while it
//                learned
//   encoding     how much the statistics are those of an image that is encoded for a screen, the
//                most likely mistake, by Fisher's linear discriminant
//
// The score is the largest, each over what is usual: what one in 300 held-out images exceeds, so
// that 99 % of them are below 1 in all.
#pragma once

#include <string>
#include <vector>

#include <torch/torch.h>

#include "common/learning/network_input.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// Logarithms, on the object, of: the mean luminance (0 where the exposure is unknown); quantiles of
// the luminance over its mean, from the 2 % to the 98 % one; differences to the neighbours over
// their mean, as median (noise) and root mean square, and the latter for neighbours 2 and 4 pixels
// away, if the object is wide enough; the area; and the part of it that is as bright as its
// brightest pixel, as where a photograph is overexposed. Finite for all images. images x count,
// double.
inline constexpr int64_t kImageStatistics = 14;
torch::Tensor image_statistics(const v1::Model& model, const ImageBatch& images);

// Of some images.
struct Features {
  torch::Tensor embedding;   // images x embedding_size(), float
  torch::Tensor statistics;  // images x kImageStatistics, double
};

// The images as a screen would have them: by turns the brightest pixel stays as bright, or the
// mean.
ImageBatch encoded_for_screen(const ImageBatch& images);

// From images of training, the statistics of the same or others encoded_for_screen(), and images of
// held-out shapes. Deterministic. Requires two images of each at least.
v1::Familiarity fit_familiarity(const Features& training, const torch::Tensor& encoded,
                                const Features& held_out);

// See v1::Unfamiliarity.
struct Unfamiliarity {
  double score = 0, rank = 0;
  bool unfamiliar = false;
  std::string reason;
};

class FamiliarityMeasure {
 public:
  // For embeddings of this size. Throws Error (invalid input) if the numbers do not make sense.
  FamiliarityMeasure(const v1::Familiarity& familiarity, int64_t embedding_size);

  // One for each image.
  std::vector<Unfamiliarity> of(const Features& images) const;

  // Each over what is usual: images, double.
  struct Distances {
    torch::Tensor embedding, statistics, encoding;

    torch::Tensor largest() const {
      return torch::maximum(torch::maximum(embedding, statistics), encoding);
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
  std::string unusual(const torch::Tensor& statistics) const;

  Gaussian embedding_, statistics_;
  torch::Tensor encoding_;    // direction
  torch::Tensor deviations_;  // standard deviations of the statistics
  std::vector<double> quantiles_;
};

}  // namespace itn
