#include "client/image/mask_parts.h"

#include <algorithm>
#include <cstdint>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/image/photograph.h"

namespace itn {
namespace {

constexpr int kSmallest = 200;  // a part is so many times smaller than the largest at most

struct Components {
  Components(const cv::Mat& image, int connectivity) {
    cv::Mat middles;
    count = cv::connectedComponentsWithStats(image, labels, statistics, middles, connectivity);
  }
  int area(int label) const { return statistics.at<int>(label, cv::CC_STAT_AREA); }
  bool reaches_border(int label) const {
    const auto of = [&](int what) { return statistics.at<int>(label, what); };
    return of(cv::CC_STAT_LEFT) == 0 || of(cv::CC_STAT_TOP) == 0 ||
           of(cv::CC_STAT_LEFT) + of(cv::CC_STAT_WIDTH) == labels.cols ||
           of(cv::CC_STAT_TOP) + of(cv::CC_STAT_HEIGHT) == labels.rows;
  }

  int count = 0;  // the first of them is what is 0
  cv::Mat labels, statistics;
};

}  // namespace

MaskParts drop_specks(std::vector<float>& mask, int width, int height) {
  cv::Mat on_object(height, width, CV_8U);
  std::ranges::transform(mask, on_object.begin<uint8_t>(),
                         [](float value) { return uint8_t{is_on_object(value)}; });
  MaskParts result;
  const Components parts(on_object, 8);
  int largest = 0, left = 0;
  for (int label = 1; label < parts.count; ++label) largest = std::max(largest, parts.area(label));
  const auto is_speck = [&](int label) {
    return label > 0 && int64_t{parts.area(label)} * kSmallest < largest;
  };
  for (int label = 1; label < parts.count; ++label) {
    if (is_speck(label)) {
      ++result.specks;
      result.speck_pixels += static_cast<size_t>(parts.area(label));
    } else {
      ++result.parts;
      left += parts.area(label);
    }
  }
  auto label = parts.labels.begin<int>();
  auto on = on_object.begin<uint8_t>();
  for (float& value : mask) {
    if (is_speck(*label)) {
      value = 0;
      *on = 0;
    }
    ++label, ++on;
  }
  const Components around(1 - on_object, 4);
  int hole = 0, holes = 0;
  std::vector<bool> is_hole(static_cast<size_t>(around.count));
  for (int each = 1; each < around.count; ++each) {
    if (around.reaches_border(each)) continue;
    is_hole[static_cast<size_t>(each)] = true;
    hole = std::max(hole, around.area(each));
    holes += around.area(each);
  }
  cv::Mat filled = on_object;
  std::transform(filled.begin<uint8_t>(), filled.end<uint8_t>(), around.labels.begin<int>(),
                 filled.begin<uint8_t>(), [&](uint8_t is_on, int each) {
                   return uint8_t{is_on != 0 || is_hole[static_cast<size_t>(each)]};
                 });
  constexpr double kRectangle = 0.98;
  const cv::Rect box = cv::boundingRect(filled);
  result.is_rectangle = left > 0 && left + holes > kRectangle * box.area();
  const double pixels = static_cast<double>(mask.size());
  result.filled = (left + holes) / pixels;
  result.largest_hole = hole / pixels;
  return result;
}

}  // namespace itn
