#include "client/image/background_mask.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/error.h"

namespace itn {
namespace {

// The longer side of the copy that is looked at.
constexpr int kCopySide = 512;
constexpr int kMinSide = 16;
constexpr double kMinObject = 0.005;  // of the photograph
constexpr double kMaxOfBorder = 0.5;
// A pixel is taken for the object at first where it differs from the background by so many times
// what the border itself does, and by so much of the range of tones at least.
constexpr double kDeviations = 4;
constexpr double kMinDifference = 0.02;
constexpr int kIterations = 5;

// OpenCV's views do not know of constness; nothing is written into this one.
cv::Mat view(int width, int height, int channels, std::span<const float> pixels) {
  return {height, width, CV_32FC(channels), const_cast<float*>(pixels.data())};
}

// At most kCopySide a side, of three channels.
cv::Mat small_copy(const cv::Mat& photograph) {
  cv::Mat copy = photograph;
  if (copy.channels() == 1) cv::cvtColor(copy, copy, cv::COLOR_GRAY2BGR);
  const double scale = double{kCopySide} / std::max(copy.cols, copy.rows);
  if (scale < 1) {
    // A strip keeps some pixels across.
    const auto scaled = [&](int side) {
      return std::max(std::min(side, kMinSide), static_cast<int>(std::lround(side * scale)));
    };
    cv::resize(copy, copy, {scaled(copy.cols), scaled(copy.rows)}, 0, 0, cv::INTER_AREA);
  }
  return copy;
}

// The median of the values where the mask is not 0.
float median(const cv::Mat& values, const cv::Mat& mask) {
  std::vector<float> chosen;
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) {
      if (mask.at<uint8_t>(y, x) != 0) chosen.push_back(values.at<float>(y, x));
    }
  }
  const auto middle = chosen.begin() + static_cast<ptrdiff_t>(chosen.size() / 2);
  std::nth_element(chosen.begin(), middle, chosen.end());
  return *middle;
}

// The logarithm of radiance, and a little for black.
cv::Mat logarithm_of(const cv::Mat& light) {
  const double largest = cv::norm(light, cv::NORM_INF);
  if (!(largest > 0)) throw invalid_input("the photograph is black: there is no object in it");
  cv::Mat logarithm;
  cv::log(light + cv::Scalar::all(1e-4 * largest), logarithm);
  return logarithm;
}

// Tones in [0, 1) of any radiance, the mean one near the middle: v / (v + mean), as in Reinhard et
// al., "Photographic tone reproduction for digital images", SIGGRAPH 2002. The mean is the
// geometric one, which a highlight does not move.
cv::Mat tones(const cv::Mat& copy) {
  const cv::Mat light = cv::max(copy, 0.0F);
  const cv::Scalar mean = cv::mean(logarithm_of(light));
  const double middle = std::exp((mean[0] + mean[1] + mean[2]) / 3);
  cv::Mat compressed;
  cv::divide(light, light + cv::Scalar::all(middle), compressed);
  cv::medianBlur(compressed, compressed, 5);  // against noise; edges stay where they are
  return compressed;
}

// A frame of this width is taken for the background.
int border_width(cv::Size size) {
  return std::max(1, std::min(size.width, size.height) / 40);
}

cv::Mat border_of(cv::Size size) {
  cv::Mat border(size, CV_8U, cv::Scalar(1));
  const int width = border_width(size);
  border(cv::Rect(width, width, size.width - 2 * width, size.height - 2 * width)) = 0;
  return border;
}

// What is left of the tones without a background that changes smoothly: a polynomial of second
// degree, the least squares' for the border.
cv::Mat without_background(const cv::Mat& image, const cv::Mat& border) {
  const auto terms = [&](int x, int y) {
    const float u = 2.0F * static_cast<float>(x) / static_cast<float>(image.cols) - 1;
    const float v = 2.0F * static_cast<float>(y) / static_cast<float>(image.rows) - 1;
    return cv::Matx<float, 1, 6>(1, u, v, u * u, u * v, v * v);
  };
  const int count = cv::countNonZero(border);
  cv::Mat positions(count, 6, CV_32F), values(count, 3, CV_32F);
  int row = 0;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      if (border.at<uint8_t>(y, x) == 0) continue;
      cv::Mat(terms(x, y)).copyTo(positions.row(row));
      cv::Mat(image.at<cv::Vec3f>(y, x).t()).copyTo(values.row(row));
      ++row;
    }
  }
  cv::Mat polynomial;  // 6 x 3
  cv::solve(positions, values, polynomial, cv::DECOMP_SVD);
  const cv::Matx<float, 6, 3> coefficients = polynomial;
  cv::Mat rest = image.clone();
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const cv::Matx<float, 1, 3> background = terms(x, y) * coefficients;
      rest.at<cv::Vec3f>(y, x) -= cv::Vec3f(background.val);
    }
  }
  return rest;
}

// How far each pixel is from the background.
cv::Mat distance(const cv::Mat& rest) {
  cv::Mat squares, sum;
  cv::multiply(rest, rest, squares);
  cv::transform(squares, sum, cv::Matx13f(1, 1, 1));
  cv::sqrt(sum, sum);
  return sum;
}

// Shadows: where the photograph is darker than its background and has its colour, though what
// differs from the background has another. There are none in a gray photograph, or of a gray
// object.
cv::Mat shadows(const cv::Mat& copy, const cv::Mat& border, const cv::Mat& differs) {
  constexpr double kColoured = 0.2, kLikeBackground = 0.4;  // of log ratios; of the object's
  cv::Mat none(copy.size(), CV_8U, cv::Scalar(0));
  if (cv::countNonZero(differs) == 0) return none;
  cv::Mat logarithm = logarithm_of(cv::max(copy, 0.0F)), mean, chroma;
  cv::medianBlur(logarithm, logarithm, 5);
  const cv::Mat ratios = without_background(logarithm, border);
  cv::transform(ratios, mean, cv::Matx13f(1 / 3.0F, 1 / 3.0F, 1 / 3.0F));
  cv::merge(std::vector<cv::Mat>(3, mean), chroma);
  chroma = distance(ratios - chroma);
  const double of_object = median(chroma, differs);
  if (of_object < kColoured) return none;
  return (mean < 0) & (chroma < kLikeBackground * of_object);
}

bool is_large_enough(const cv::Mat& object) {
  return cv::countNonZero(object) >= kMinObject * static_cast<double>(object.total());
}

Error no_object(const char* why) {
  return invalid_input(
      fmt::format("no object can be told from the background of the photograph: {}. The object "
                  "must be before a "
                  "plain background that is seen all around it; or give its mask",
                  why));
}

// From which difference on a pixel is taken for the object at first. Of the border's own
// differences the median counts, as a part of the object may be there.
double least_difference(const cv::Mat& difference, const cv::Mat& border) {
  return std::max(kDeviations * median(difference, border), kMinDifference);
}

// By GrabCut, from the pixels `first`.
cv::Mat object_pixels(const cv::Mat& rest, const cv::Mat& border, const cv::Mat& first) {
  cv::Mat labels(rest.size(), CV_8U, cv::Scalar(cv::GC_PR_BGD));
  labels.setTo(cv::GC_PR_FGD, first);
  labels.setTo(cv::GC_BGD, border);
  if (!is_large_enough(labels == cv::GC_PR_FGD)) throw no_object("nothing differs from its border");
  cv::Mat bytes;
  rest.convertTo(bytes, CV_8UC3, 127, 128);  // tones less tones are in (-1, 1)
  cv::Mat background_model, object_model;
  cv::setRNGSeed(1);  // for its choice of clusters
  cv::grabCut(bytes, labels, {}, background_model, object_model, kIterations,
              cv::GC_INIT_WITH_MASK);
  return (labels == cv::GC_FGD) | (labels == cv::GC_PR_FGD);
}

cv::Mat largest_part(const cv::Mat& mask) {
  cv::Mat labels, statistics, centres;
  const int count = cv::connectedComponentsWithStats(mask, labels, statistics, centres, 8);
  int largest = 0;
  for (int part = 1; part < count; ++part) {  // 0 is what is no part
    const auto area = [&](int i) { return statistics.at<int>(i, cv::CC_STAT_AREA); };
    if (largest == 0 || area(part) > area(largest)) largest = part;
  }
  return largest == 0 ? cv::Mat(mask.size(), CV_8U, cv::Scalar(0)) : cv::Mat(labels == largest);
}

// The background is what can be reached from the corner, as the object does not reach the border.
cv::Mat without_holes(const cv::Mat& mask) {
  cv::Mat outside = mask.clone();
  cv::floodFill(outside, {0, 0}, cv::Scalar(255));
  return mask | ~outside;
}

// The part of a second frame within the border, as wide, that is the object's.
double part_along_border(const cv::Mat& mask) {
  const int width = border_width(mask.size());
  const cv::Mat inside = mask(cv::Rect(width, width, mask.cols - 2 * width, mask.rows - 2 * width));
  cv::Mat frame(inside.size(), CV_8U, cv::Scalar(255));
  frame(cv::Rect(width, width, inside.cols - 2 * width, inside.rows - 2 * width)) = 0;
  return static_cast<double>(cv::countNonZero(inside & frame)) / cv::countNonZero(frame);
}

}  // namespace

std::vector<float> mask_from_background(int width, int height, int channels,
                                        std::span<const float> pixels) {
  if (width < kMinSide || height < kMinSide) {
    throw invalid_input(fmt::format(
        "the photograph has {} x {} pixels: too few to tell an object from its background; {} x {} "
        "are the least",
        width, height, kMinSide, kMinSide));
  }
  const cv::Mat copy = small_copy(view(width, height, channels, pixels));
  const cv::Mat image = tones(copy);
  const cv::Mat border = border_of(image.size());
  const cv::Mat rest = without_background(image, border);
  const cv::Mat difference = distance(rest);
  const double least = least_difference(difference, border);
  const cv::Mat first = difference > least;
  const cv::Mat shadow = shadows(copy, border, first);
  const cv::Mat object =
      without_holes(largest_part(object_pixels(rest, border, first & ~shadow) & ~shadow));
  if (!is_large_enough(object) || median(difference, object) < least) {
    throw no_object("nothing of some size differs from its border");
  }
  if (part_along_border(object) > kMaxOfBorder) {
    throw no_object("what differs lies along most of its border");
  }
  cv::Mat whole;
  object.convertTo(whole, CV_32F, 1 / 255.0);
  cv::resize(whole, whole, {width, height}, 0, 0, cv::INTER_LINEAR);
  cv::threshold(whole, whole, 0.5, 1, cv::THRESH_BINARY);
  return {whole.begin<float>(), whole.end<float>()};
}

}  // namespace itn
