// The material of an object of known shape in known light, by analysis by synthesis.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/options.h"
#include "client/image/image.h"
#include "client/predict/photograph_input.h"
#include "common/material.h"
#include "itn/v1/refine.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {

struct RefineOptions {
  std::vector<std::string> images, scenes;
  std::string mask;  // a file, or a folder; empty: the images' own
  FileReading reading;
  std::optional<v1::LengthUnit> mesh_unit;
  std::optional<v1::Film::Channel> channel;  // of the films, instead of what the scenes say
  std::string init = "network";
  std::string model;
  uint32_t starts = 1;
  v1::RefineSettings settings;
  double seconds_before = 0;  // RefineRun
  std::string output;
  bool json = false;
  WorkerFlags workers;
};

// What a film has of an image whose channels these are, Y or R, G and B.
std::vector<float> radiance_of(const Image& image, const std::vector<std::string>& channels,
                               v1::Film::Channel film);

// The scenes of the images, one for each, with their files. Throws Error as load_scene() does,
// kUsage if they are not as many, and (invalid input) if their films are of different channels.
std::vector<v1::Scene> load_scenes(const RefineOptions& options);

// A pixel that was averaged is on the object if so much of it was, and clipped if more was.
inline constexpr float kWholePixel = 0.99F, kClippedPixel = 0.001F;

// An image larger than the film, of the same shape, is averaged down to it; a pixel of the mask is
// then 1 where all of it was. Throws Error (invalid input) if it is smaller or of another shape; or
// larger where the scene's camera shows a part of its frame, as nothing says that the image does.
void average_to_film(const std::string& name, const v1::Scene& scene, PhotographContent& content,
                     std::vector<float>& mask);

// Takes pixels at the top of what a file can hold out of the mask, with a warning.
void leave_out_clipped(const std::string& name, const std::vector<unsigned char>& clipped,
                       std::vector<float>& mask);

inline constexpr std::array kColours{v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE};

// The channel of an EXR that is one of Observation::disturbances, of a colour (R, G, B) or, where
// that is empty, of the only channel.
std::string disturbance_name(size_t which, const std::string& colour);

// The material where --init mean starts, for an object of this longest side in mm.
Material mean_of_size(double longest_side);

// Throws Error (usage) if --init is none of what it may be.
void check_init(const std::string& init);

// What run_refine() prints: of the luminance or a colour, or of red, green and blue, as the films
// say. Whoever calls has locked the output folder.
std::vector<v1::RefineResult> find_materials(const RefineOptions& options);

void run_refine(const RefineOptions& options);

}  // namespace itn
