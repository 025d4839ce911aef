// Square images as matrices of OpenCV's.
#pragma once

#include <span>

#include <opencv2/core.hpp>

namespace itn {

// Which does not write into it; the values must outlive it.
inline cv::Mat square_view(int side, std::span<const float> values) {
  return {side, side, CV_32F, const_cast<float*>(values.data())};
}

}  // namespace itn
