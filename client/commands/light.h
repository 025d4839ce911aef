// The light of a room from a photograph of a ball that mirrors it.
#pragma once

#include <optional>
#include <string>

#include "client/predict/photograph_input.h"

namespace itn {

struct LightOptions {
  std::string image;
  PhotographOptions photograph;
  std::optional<double> focal_length_35mm;  // absent: as EXIF says
  double camera_down = 0;                   // degrees below the horizon
  double reflectance = 1;                   // of the ball
  int rows = 128;                           // of the panorama
  std::string output;
};

void run_light(const LightOptions& options);

}  // namespace itn
