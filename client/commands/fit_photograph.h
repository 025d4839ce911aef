// What itn fit sees: the photograph of an object, and the scene that it is one of.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/fit.h"
#include "client/fit/silhouette.h"
#include "client/image/image.h"
#include "common/geometry/mesh.h"
#include "common/geometry/pose.h"
#include "common/image/photograph.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// What relates the numbers of a photograph's file to the light of its scene.
struct Exposure {
  // What EXIF says of the exposure.
  std::optional<double> seconds, f_number, iso;
  std::vector<double> factors;  // by channel, as the gray card says; else 1
};

// A square about the object, at the side of the fit and at that of the search for its pose.
struct FitPhotograph {
  std::string name;
  std::vector<std::string> channels;  // Y, or R, G, B
  Image image;                        // of these, side x side
  std::vector<float> mask, clipped;   // likewise
  int side = 0, pose_side = 0;
  std::vector<float> pose_mask;
  std::vector<float> picture;  // of the first channel, for people, pose_side x pose_side
  int width = 0, height = 0;   // of the whole photograph
  Square square;
  double focal = 0;   // in pixels of the whole photograph
  Exposure exposure;  // by which the image is scaled
  // What is said of it, in degrees.
  std::optional<double> panorama_turn;  // absent: as light and shade say
  double camera_down = 0;
};

// `first`: the exposure of the first photograph, which has the card if there is one; absent for
// that itself. Throws Error as read_marked() does, and (invalid input) if the object is cut off,
// too small, the focal length is not known, or it was exposed otherwise than the first.
FitPhotograph load_fit_photograph(const std::string& name, const FitOptions& options,
                                  const std::optional<Exposure>& first = {});

// The focal length of its lens in pixels of the photograph, as is said, or by EXIF. Throws Error
// (invalid input) if neither says it.
double focal_in_pixels(const PhotographContent& content, const std::string& name,
                       std::optional<double> length_35mm);

// STEM.EXT in the folder of a fit, or one of those that it has of each of several photographs:
// STEM_0.EXT and so on.
std::filesystem::path file_of(const std::filesystem::path& folder, const std::string& stem,
                              const std::string& extension, const FitOptions& options, size_t i);
// The photograph as it was compared.
std::filesystem::path photograph_file(const std::filesystem::path& folder,
                                      const FitOptions& options, size_t i);

// The camera of the photograph in an image of the square, of another side.
PinholeView view_of(const FitPhotograph& photograph, int side);

// Neighbouring pixels of an image differ alike. Sets RefineSettings.block, the side of squares that
// count as one, to a 24th of the frame's, or less, so that the mask has 60 of them; and model_error
// and its length to what a shape that is so far off makes of an image whose object has this mask.
// Called for several images, the smallest block and the longest length are left. Throws Error
// (invalid input) if the mask has fewer than 60 pixels.
void allow_for_likeness(const std::vector<float>& mask, int width, const std::string& name,
                        double shape_error, RefineOptions& refine);

// A shape that is no file.
bool is_builtin(const std::string& shape);
bool is_by_flash(const FitOptions& options);
bool is_in_sun(const FitOptions& options);

// How object and camera stand in the light.
struct Stand {
  Pose pose;  // in front of the camera
  // In degrees: of panorama or sun counter-clockwise seen from above, 0 where the camera looks; of
  // the camera below the horizon, and of the sun above it.
  double panorama_turn = 0, camera_down = 0, sun_elevation = 0;
};

// How far the object's middle is from the flash, in mm.
double flash_range(const Stand& stand, const Mesh& shape, const FitOptions& options);

// Without a stand: the camera is at the origin and looks along -z, and the object is where its mesh
// has it.
v1::Scene scene_of(const FitPhotograph& photograph, const FitOptions& options);

// Turns camera and light of such a scene, and moves its object to where the pose has the shape. A
// flash is then so bright that a white card has radiance 1 which faces it, as far away as the
// object or as was said.
void place(const Stand& stand, const Mesh& shape, const FitOptions& options, v1::Scene& scene);

// 1 where a pixel, of the side of the fit, shows the object alone in the photograph and in the
// scene, and nothing that is clipped; else 0.
std::vector<float> pixels_of_object(const FitPhotograph& photograph, const Mesh& shape,
                                    const Pose& pose);

// pixels_of_object(), but 0 at contours of one part of the object before another, too: a shape that
// is a little off shows something else there. Contours tell poses apart, and nothing of the
// material.
std::vector<float> pixels_of_surfaces(const FitPhotograph& photograph, const Mesh& shape,
                                      const Pose& pose);

}  // namespace itn
