// One linear image of several photographs of a scene that nothing moved in, each exposed
// differently: a bracket from a tripod.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "client/image/photograph_file.h"

namespace itn {

// Linear light at the encoded values 0, 1/255, ..., 1, by channel.
using Response = std::vector<std::array<float, 256>>;

Response srgb_response(int channels);

// An exposure of the scene, for finding the response: a few of the pixels of a photograph, encoded.
struct ExposureSample {
  double exposure = 0;  // proportional to the light that the sensor got: seconds
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<unsigned char> codes;  // channels interleaved
};

// Samples a photograph whose values are encoded, and which has R, G and B or one channel.
ExposureSample sample_exposure(const PhotographFile& photograph, double exposure,
                               const std::string& name);

// After Debevec and Malik, least sure at both ends of the range. Such that code 128 is of the light
// that it is by sRGB, as only ratios can be known. Throws Error (invalid input) if the samples do
// not tell the response, or are not of one size.
Response estimate_response(const std::vector<ExposureSample>& samples);

// The mean of the logarithms, with weights that fall linearly from the middle of the encoded values
// to both ends (Debevec and Malik, "Recovering high dynamic range radiance maps from photographs",
// SIGGRAPH 1997). Takes one photograph at a time: its memory does not grow with their number.
class ExposureMerge {
 public:
  // No response: the files are linear.
  explicit ExposureMerge(std::optional<Response> response) : response_(std::move(response)) {}

  // Throws Error (invalid input) if its size or channels are not those of the ones before, or if
  // its light over exposure is not theirs, by more than kWrong times in the median: then the times
  // are wrong, or the response is. `name` is for messages.
  void add(const PhotographFile& photograph, double exposure, const std::string& name);

  // R, G and B, or Y: light of the files over exposure. Where every exposure is clipped, what the
  // least exposed says, which the truth is not below, and clipped.Y is 1 (a channel that is there
  // if a pixel is); where every one is black, the most exposed.
  // Throws Error (invalid input) if no pixel was well exposed in any.
  Image merged() const;
  // What was more than kDoubtful times off, a sentence each.
  const std::vector<std::string>& doubts() const { return doubts_; }
  static constexpr double kDoubtful = 1.15, kWrong = 1.6;
  // Pixels of which a channel is clipped in every exposure.
  size_t clipped_count() const;

 private:
  std::vector<float> clipped_everywhere() const;

  struct Sums {
    std::vector<float> weight, value;
    std::vector<float> bound;  // see add()
  };

  void add_channel(size_t channel, const std::vector<float>& plane, bool encoded, double top,
                   double exposure, std::vector<double>& differences);
  void compare(std::vector<double> differences, const std::string& name);

  std::optional<Response> response_;
  int width_ = 0;
  int height_ = 0;
  std::vector<std::string> names_;  // of the channels
  std::vector<Sums> sums_;          // likewise
  std::vector<std::string> doubts_;
};

}  // namespace itn
