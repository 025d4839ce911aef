// photograph_bench: what defects of photographs do to the answers of trained networks. Renders of a
// dataset, gray or in colour of a right white balance, become photographs of 256 x 256 pixels, by a
// camera of its own that has nothing in common with what networks are trained with
// (client/training/camera_augmentation.h), go through a file, and are predicted as a user's would
// be. One row for each defect, and one for a careless photograph that has most of them.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "client/dataset/dataset.h"
#include "client/image/photograph_file.h"
#include "client/training/evaluation.h"
#include "client/training/training_set.h"
#include "common/error.h"
#include "common/image/photograph.h"
#include "common/image/square_view.h"
#include "common/learning/model_files.h"
#include "common/learning/predictor.h"
#include "common/random.h"
#include "tests/bench/photograph_encoding.h"

namespace itn {
namespace {

constexpr int kSide = 256;
constexpr double kPi = std::numbers::pi;

// --- Cameras ---

enum class Background { kGray, kTextured, kBright };
enum class Curve { kSrgb, kFilmic };

struct Defects {
  Background background = Background::kGray;
  bool vignetting = false;
  double blur = 0;  // pixels of the photograph: standard deviation of a Gaussian
  Curve curve = Curve::kSrgb;
  std::optional<Encoding> file = std::nullopt;  // without: linear numbers
  double stops = 0;                             // overexposed by
  int mask_error = 0;                           // pixels of the photograph
  bool cut = false;                             // a quarter of the object is outside of the frame
};

struct Row {
  const char* name;
  Defects defects;
  bool other_dataset = false;
};

// `network_pixel`: a pixel of the network, in the photograph's.
std::vector<Row> rows(int network_pixel) {
  return {
      {"none: linear, gray background", {}},
      {"textured background", {.background = Background::kTextured}},
      {"bright coloured background", {.background = Background::kBright}},
      {"8 bits by the sRGB curve", {.file = Encoding::kPng}},
      {"JPEG of quality 80", {.file = Encoding::kJpeg}},
      {"JPEG, bright background", {.background = Background::kBright, .file = Encoding::kJpeg}},
      {"vignetting cos^4, 31 degrees", {.vignetting = true}},
      {"blur of half a network pixel", {.blur = 0.5 * network_pixel}},
      {"blur of a network pixel", {.blur = static_cast<double>(network_pixel)}},
      {"filmic curve, decoded as sRGB", {.curve = Curve::kFilmic, .file = Encoding::kPng}},
      {"overexposed by a stop", {.file = Encoding::kPng, .stops = 1}},
      {"mask off by a pixel", {.mask_error = 1}},
      {"mask off by a network pixel", {.mask_error = network_pixel}},
      {"a quarter outside of the frame", {.cut = true}},
      {"careless: several of these",
       {.background = Background::kTextured,
        .vignetting = true,
        .blur = 0.5 * network_pixel,
        .curve = Curve::kFilmic,
        .file = Encoding::kJpeg,
        .mask_error = network_pixel / 2}},
      {"images that the model is not for", {}, true},
  };
}

// The object alone: radiance of red, green and blue times coverage, and coverage.
struct Layer {
  cv::Mat radiance, coverage;
  double mean = 0;        // over the object and the colours
  double highlights = 0;  // 99th percentile over the object, of the brightest colour
};

// A gray image of `side` pixels as one of kSide.
cv::Mat enlarged(int side, std::span<const float> values) {
  cv::Mat result;
  cv::resize(square_view(side, values), result, cv::Size(kSide, kSide), 0, 0, cv::INTER_LINEAR);
  return result;
}

// Pixels that the object covers in part show in a render what is behind it: they get the mean of
// those around them that it fills.
cv::Mat of_object_alone(const cv::Mat& luminance, const cv::Mat& mask) {
  cv::Mat full, sum, count;
  cv::threshold(mask, full, 0.99, 1, cv::THRESH_BINARY);
  cv::boxFilter(luminance.mul(full), sum, -1, cv::Size(5, 5), cv::Point(-1, -1), false);
  cv::boxFilter(full, count, -1, cv::Size(5, 5), cv::Point(-1, -1), false);
  cv::Mat result = luminance.clone();
  for (int i = 0; i < static_cast<int>(mask.total()); ++i) {
    if (full.ptr<float>()[i] < 1 && count.ptr<float>()[i] > 0.5F) {
      result.ptr<float>()[i] = sum.ptr<float>()[i] / count.ptr<float>()[i];
    }
  }
  return result;
}

// `channels`: of an image, one or three.
Layer layer_of(const std::vector<DatasetImage>& channels, int side) {
  Layer layer;
  const std::vector<float>& on_object = channels.front().mask;
  const cv::Mat mask = square_view(side, on_object);
  layer.coverage = enlarged(side, on_object);
  std::vector<cv::Mat> colours;
  for (const DatasetImage& channel : channels) {
    const cv::Mat product = of_object_alone(square_view(side, channel.radiance), mask).mul(mask);
    colours.push_back(enlarged(side, {product.ptr<float>(), product.total()}));
    std::vector<float> values;
    for (int i = 0; i < kSide * kSide; ++i) {
      const float coverage = layer.coverage.ptr<float>()[i];
      if (coverage > 0.5F) values.push_back(colours.back().ptr<float>()[i] / coverage);
    }
    double sum = 0;
    for (const float value : values) sum += value;
    layer.mean += sum / static_cast<double>(values.size() * channels.size());
    const auto high = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 99 / 100);
    std::nth_element(values.begin(), high, values.end());
    layer.highlights = std::max(layer.highlights, static_cast<double>(*high));
  }
  if (colours.size() == 1) colours.resize(3, colours.front());
  cv::merge(colours, layer.radiance);
  return layer;
}

// Red, green and blue over the object's mean.
cv::Vec3f behind(Background background, int x, int y) {
  switch (background) {
    case Background::kGray: break;
    case Background::kTextured: {  // a weave of stripes
      const auto stripes = static_cast<float>(std::sin(0.35 * x + 0.1 * y) * std::sin(0.28 * y));
      return cv::Vec3f::all(0.7F + 0.5F * stripes);
    }
    case Background::kBright: return {3, 0.4F, 1.8F};
  }
  return cv::Vec3f::all(0.5F);
}

// The scene before the camera.
cv::Mat composite(const Layer& layer, Background background) {
  cv::Mat scene(kSide, kSide, CV_32FC3);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const float coverage = layer.coverage.at<float>(y, x);
      scene.at<cv::Vec3f>(y, x) =
          layer.radiance.at<cv::Vec3f>(y, x) +
          behind(background, x, y) * ((1 - coverage) * static_cast<float>(layer.mean));
    }
  }
  return scene;
}

// A lens whose frame reaches to 31 degrees off the axis, at its corners.
void darken_corners(cv::Mat& scene) {
  constexpr double kCornerTangent = 0.6;
  const double corner = std::hypot(kSide / 2.0, kSide / 2.0);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double t =
          kCornerTangent / corner * std::hypot(x + 0.5 - kSide / 2.0, y + 0.5 - kSide / 2.0);
      scene.at<cv::Vec3f>(y, x) *= static_cast<float>(std::pow(1 + t * t, -2));  // cos^4
    }
  }
}

// What a camera makes of linear light, 1 the brightest, before sRGB's curve. Filmic: the fit to the
// ACES reference rendering by Narkowicz ("ACES Filmic Tone Mapping Curve", 2015).
double developed(Curve curve, double x) {
  const double y =
      curve == Curve::kFilmic ? x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14) : x;
  return std::clamp(y, 0.0, 1.0);
}

// The exposure that brings `brightest` to 0.9 of what is white. Curves rise.
double exposure_for(Curve curve, double brightest) {
  double low = 0, high = 100;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (developed(curve, middle) < 0.9 ? low : high) = middle;
  }
  return low / brightest;
}

// IEC 61966-2-1.
double srgb_of_linear(double linear) {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

std::string encoded(const cv::Mat& developed_scene, Encoding encoding) {
  std::vector<unsigned char> bytes;
  for (int i = 0; i < kSide * kSide; ++i) {
    for (int c = 0; c < 3; ++c) {
      const double linear = developed_scene.ptr<cv::Vec3f>()[i][c];
      bytes.push_back(static_cast<unsigned char>(std::lround(255 * srgb_of_linear(linear))));
    }
  }
  return encoded(kSide, kSide, bytes, encoding);
}

// As the file's reader sees it.
cv::Mat decoded(const std::string& bytes) {
  Image image = decode_photograph(bytes, "photograph").image;
  std::vector<cv::Mat> colours;
  for (const char* const name : {"R", "G", "B"}) {
    colours.emplace_back(kSide, kSide, CV_32F, image.channels.at(name).data());
  }
  cv::Mat scene;
  cv::merge(colours, scene);
  return scene;
}

// Wider or narrower, and moved, by so many pixels.
cv::Mat imprecise(const cv::Mat& mask, int pixels, SplitMix& random) {
  if (pixels == 0) return mask;
  const cv::Mat disc =
      cv::getStructuringElement(cv::MORPH_ELLIPSE, cv::Size(2 * pixels + 1, 2 * pixels + 1));
  cv::Mat border, result;
  random.uniform() < 0.5 ? cv::dilate(mask, border, disc) : cv::erode(mask, border, disc);
  const auto to_a_side = [&] { return random.uniform() < 0.5 ? -pixels : pixels; };
  const cv::Matx23d movement(1, 0, to_a_side(), 0, 1, to_a_side());
  cv::warpAffine(border, result, movement, mask.size());
  return result;
}

// A photograph as a user has it: red, green and blue of each pixel, or green alone, its mask, and
// what its radiance must be multiplied by to be that of the scene.
struct Taken {
  int width = kSide;
  size_t channels = 3;
  std::vector<float> pixels, mask;
  double factor = 1;
};

// Columns at the right are lost until a quarter of the object is.
void cut(Taken& photograph) {
  std::vector<double> columns(kSide);
  double sum = 0;
  for (size_t i = 0; i < photograph.mask.size(); ++i) {
    columns[i % kSide] += photograph.mask[i];
    sum += photograph.mask[i];
  }
  int width = kSide;
  for (double lost = 0; width > 1 && lost < sum / 4; --width) lost += columns[width - 1];
  const auto cropped = [&](const std::vector<float>& values, size_t channels) {
    std::vector<float> result;
    for (size_t y = 0; y < kSide; ++y) {
      const auto row = values.begin() + static_cast<std::ptrdiff_t>(y * kSide * channels);
      result.insert(result.end(), row, row + static_cast<std::ptrdiff_t>(width * channels));
    }
    return result;
  };
  photograph.pixels = cropped(photograph.pixels, photograph.channels);
  photograph.mask = cropped(photograph.mask, 1);
  photograph.width = width;
}

// A white card beside the object, which is under 100 W/m^2 in datasets of preset `any`.
constexpr double kWhiteCard = 100 / kPi;

// `card`: it must not be overexposed either, and tells the scale. `channels`: what is seen of it.
Taken take(const Layer& layer, const Defects& defects, bool card, size_t channels, uint64_t seed) {
  SplitMix random(seed);
  cv::Mat scene = composite(layer, defects.background);
  if (defects.vignetting) darken_corners(scene);
  if (defects.blur > 0) cv::GaussianBlur(scene, scene, cv::Size(), defects.blur);
  Taken photograph{.channels = channels, .pixels = {}, .mask = {}};
  if (defects.file) {
    const double exposure =
        exposure_for(defects.curve,
                     card ? std::max(layer.highlights, kWhiteCard) : layer.highlights) *
        std::exp2(defects.stops);
    scene.forEach<cv::Vec3f>([&](cv::Vec3f& pixel, const int*) {
      for (int c = 0; c < 3; ++c) {
        pixel[c] = static_cast<float>(developed(defects.curve, exposure * pixel[c]));
      }
    });
    scene = decoded(encoded(scene, *defects.file));
    photograph.factor = kWhiteCard / developed(defects.curve, exposure * kWhiteCard);
  }
  if (channels == 1) cv::extractChannel(scene, scene, 1);
  photograph.pixels.assign(scene.ptr<float>(), scene.ptr<float>() + scene.total() * channels);
  const cv::Mat mask = imprecise(layer.coverage, defects.mask_error, random);
  photograph.mask.assign(mask.begin<float>(), mask.end<float>());
  if (defects.cut) cut(photograph);
  return photograph;
}

// --- Answers ---

struct Options {
  std::vector<std::string> models;
  std::string dataset, other;
  v1::Split split = v1::SPLIT_TEST;
  std::string rows;  // part of the names of those that are wanted
  size_t images = 0;
  int threads = 1;
};

// Some images of a dataset.
LabelledImages some_images(DatasetReader& dataset, const Options& options) {
  LabelledImages images = images_of(dataset, options.split);
  if (options.images > 0 && options.images < images.items.size()) {
    images.items.resize(options.images);
    images.truth.resize(options.images * images.channels);
  }
  return images;
}

std::vector<MaterialEstimate> answer(Predictor& predictor, Taken photograph) {
  if (predictor.model().exposure() != v1::EXPOSURE_UNKNOWN) {
    for (float& pixel : photograph.pixels) pixel *= static_cast<float>(photograph.factor);
  }
  return predictor.estimate(Photograph{.width = photograph.width,
                                       .height = kSide,
                                       .channels = static_cast<int>(photograph.channels),
                                       .pixels = photograph.pixels,
                                       .mask = photograph.mask});
}

void print(const char* name, const v1::Evaluation::Row& row) {
  const auto error = [](double value, const v1::Interval& interval) {
    return fmt::format("{:.2f} ({:.2f} to {:.2f})", value, interval.min(), interval.max());
  };
  fmt::print("{:34} {:>20} {:>20} {:>20}  {:3.0f} {:3.0f} {:3.0f} %  {:3.0f} %\n", name,
             error(row.relative().sigma_t(), row.relative_sigma_t()),
             error(row.relative().albedo(), row.relative_albedo()),
             error(row.relative().g(), row.relative_g()), 100 * row.coverage().sigma_t(),
             100 * row.coverage().albedo(), 100 * row.coverage().g(), 100 * row.outlier_fraction());
  std::fflush(stdout);
}

void run(const Options& options) {
  set_torch_threads(options.threads);
  cv::setNumThreads(1);
  DatasetReader dataset(options.dataset);
  const std::unique_ptr<DatasetReader> other =
      options.other.empty() ? nullptr : std::make_unique<DatasetReader>(options.other);
  for (const std::string& name : options.models) {
    Predictor predictor = Predictor::load(find_model(name));
    const bool card = predictor.model().exposure() != v1::EXPOSURE_UNKNOWN;
    fmt::print(
        "{} on {} images of {}: errors over the constant predictor's, truths in the 90 % "
        "intervals, flagged as outliers\n",
        predictor.name(), some_images(dataset, options).items.size(), options.dataset);
    fmt::print("{:34} {:>20} {:>20} {:>20}  {:>13}  {:>5}\n", "", "sigma_t", "albedo", "g",
               "coverage", "flag");
    for (const Row& row : rows(kSide / static_cast<int>(predictor.model().resolution()))) {
      DatasetReader* const from = row.other_dataset ? other.get() : &dataset;
      if (from == nullptr || std::string(row.name).find(options.rows) == std::string::npos) {
        continue;
      }
      const LabelledImages images = some_images(*from, options);
      std::vector<MaterialEstimate> estimates;
      std::vector<Material> predictions;
      for (size_t i = 0; i < images.items.size(); ++i) {
        const Layer layer = layer_of(read_channels(images, i), images.resolution);
        Taken photograph = take(layer, row.defects, card, images.channels, i);
        for (MaterialEstimate& estimate : answer(predictor, std::move(photograph))) {
          predictions.push_back(estimate.material);
          estimates.push_back(std::move(estimate));
        }
      }
      v1::Evaluation::Row result;
      set_errors(predictions, images, result);
      set_details(estimates, images, result);
      set_outlier_fraction(estimates, result);
      print(row.name, result);
    }
  }
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::Options options;
  CLI::App app("What defects of photographs do to the answers of trained networks");
  app.add_option("dataset", options.dataset, "Dataset whose images are photographed")->required();
  app.add_option_function<std::string>(
         "--split",
         [&](const std::string& name) {
           options.split = name == "train" ? itn::v1::SPLIT_TRAIN : itn::v1::SPLIT_TEST;
         },
         "Images that are photographed; default: test")
      ->check(CLI::IsMember({"test", "train"}));
  app.add_option("--model", options.models,
                 "Model by its name or file; several one after the other")
      ->required();
  app.add_option("--other", options.other, "Dataset of images that the models are not for");
  app.add_option("--rows", options.rows, "Only rows whose name has this in it");
  app.add_option("--images", options.images, "First so many of the split; 0: all")
      ->capture_default_str();
  app.add_option("--torch-threads", options.threads, "Threads of the network")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    itn::run(options);
  } catch (const itn::Error& error) {
    fmt::print(stderr, "photograph_bench: {}\n", error.what());
    return 1;
  }
  return 0;
}
