// The material of an object of known shape from its photograph.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "client/commands/refine.h"
#include "client/predict/photograph_input.h"

namespace itn {

struct FitOptions {
  std::vector<std::string> images;
  PhotographOptions photograph;
  // One for all of the images or one for each, where all is known; of others the shape alone is.
  std::vector<std::string> scenes;
  std::string shape;  // a mesh file, or a built-in one
  // In mm: of the longest side, or of those along x, y and z; empty: as refine.mesh_unit says.
  std::vector<double> object_size;
  bool repair = false;
  std::string light = "flash";                 // or sun, or the file of a panorama
  std::vector<double> flash_offset{0, 12, 0};  // from the lens, in mm: to the right, up, back
  std::optional<double> card_distance;         // of the gray card from the flash, in mm
  // One for all photographs or one for each, in degrees.
  std::vector<double> panorama_turn;        // empty: as light and shade say
  std::vector<double> camera_down{0};       // below the horizon
  std::optional<double> sun_elevation;      // degrees; absent: as light and shade say
  std::optional<double> focal_length_35mm;  // absent: as EXIF says
  double index = 1.5;
  // Standard deviations of what is said: of the index; of the flash's place to the side and up, in
  // mm; of the turn of a panorama and of camera_down, in degrees; of the light on the card, as a
  // part. 0: exact.
  double index_error = 0.03, flash_error = 5, turn_error = 2;
  std::optional<double> card_error;  // absent: card_error_of()
  double shape_error = 0.002;        // root mean square, as a part of the size
  // What g is taken for. 0: it is not found; what another one would change is a disturbance. Else
  // it is found, and is known so well before, as a standard deviation.
  double g = 0.4, g_error = 0;
  bool luminance = false;
  int resolution = 96;   // pixels a side of the fit
  RefineOptions refine;  // mesh unit, start, limits, output, workers
};

// The error of the card's reflectance: as said; or 0.03 by flash, and 0.06 in a panorama, where the
// object shades the card; without one 0.
double card_error_of(const FitOptions& options);

void run_fit(const FitOptions& options);

}  // namespace itn
