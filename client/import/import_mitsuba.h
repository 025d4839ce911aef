// Scenes of Mitsuba 0.6 and 3 as ours.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/material.h"
#include "itn/v1/scene.pb.h"

namespace itn {

struct ImportOptions {
  double mm_per_scene_unit = 1;
  // What of a colour becomes a number of ours: its luminance, or R, G or B.
  v1::Film::Channel channel = v1::Film::LUMINANCE;
  std::filesystem::path output_folder;             // what paths of the scene are relative to
  std::map<std::string, std::string> definitions;  // values for the $names of the file
};

struct ImportedScene {
  v1::Scene scene;
  std::optional<std::array<Material, 3>> medium;  // of R, G and B, in 1/mm
  std::string phase;  // text of a v1::PhaseFunction, if it is not that with the g of `medium`
  // Whether its medium has a colour, or its lights or surfaces and its film; an image of it should
  // be in colour then. Not where a channel is asked for.
  bool in_colour = false;
  uint32_t samples = 0;                       // per pixel; 0: the file does not say
  std::vector<std::string> not_carried_over;  // a sentence each
};

// Adds the materials of R, G and B to an object; one, where they are the same.
void add_materials(const std::array<Material, 3>& materials, v1::Object& object);

// Throws Error: kIo, kInvalidInput (with file and place): no XML, no camera, a value that cannot be
// read. What has no counterpart here is said in `not_carried_over`.
ImportedScene import_mitsuba(const std::filesystem::path& path, const ImportOptions& options);

}  // namespace itn
