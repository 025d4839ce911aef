// Flags of what is known of photographs, for who reads them.
#pragma once

#include <CLI/CLI.hpp>

#include <array>
#include <cstdlib>
#include <string>

#include "client/predict/photograph_input.h"
#include "common/flags.h"

namespace itn {

// X,Y,W,H in pixels.
inline PixelRectangle parsed_rectangle(const std::string& text) {
  std::array<int, 4> numbers{};
  size_t count = 0;
  const char* rest = text.c_str();
  for (; count < numbers.size(); ++count) {
    char* end = nullptr;
    const long number = std::strtol(rest, &end, 10);
    const bool last = count + 1 == numbers.size();
    if (end == rest || number < 0 || number > 16384 || *end != (last ? '\0' : ',')) break;
    numbers[count] = static_cast<int>(number);
    rest = end + 1;
  }
  if (count < numbers.size() || numbers[2] == 0 || numbers[3] == 0) {
    throw CLI::ValidationError("--gray-card",
                               "it must be X,Y,W,H: left, top, width and height in pixels, such as "
                               "120,40,32,32");
  }
  return {numbers[0], numbers[1], numbers[2], numbers[3]};
}

inline void add_mask_flags(CLI::App& app, PhotographOptions& options) {
  const auto mask = app.add_option(
      "--mask", options.mask,
      "Image that is bright (above half) on the object: PNG or another, of an EXR the channel "
      "mask.Y, Y, L, R or A; or a folder with one of the same name for each image. Default: the "
      "image's own channel mask.Y, or alpha");
  app.add_option_function<std::string>(
         "--background", [&options](const std::string&) { options.mask_by_background = true; },
         "auto: find the object before a plain background")
      ->check(CLI::IsMember({"auto"}))
      ->excludes(mask);
}

inline CLI::Option* add_gray_card_flags(CLI::App& app, PhotographOptions& options) {
  CLI::Option* const card = app.add_option_function<std::string>(
      "--gray-card",
      [&options](const std::string& text) { options.gray_card = parsed_rectangle(text); },
      "X,Y,W,H: pixels of a gray card beside the object; by one lamp or a flash alone it faces "
      "that, else it lies flat and faces up");
  app.add_option("--gray-reflectance,--gray", options.gray, "Reflectance of the gray card")
      ->transform(kPercentToPart)
      ->check(number_in(0.01, 1.0))
      ->needs(card)
      ->capture_default_str();
  return card;
}

}  // namespace itn
