// Small square pictures beside one another, for people to look at.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace itn {

using Rgb = std::array<unsigned char, 3>;  // sRGB

// Linear radiance over the level that is shown as white.
Rgb gray(float linear);

// A difference over the level of white: white at 0, red above, blue below; full colour is half that
// level.
Rgb diverging(float difference);

struct Panel {
  int side = 0;
  std::vector<Rgb> pixels;  // side x side, top row first
};

using PanelRow = std::vector<Panel>;  // not empty, all of one side

// The whole number by which write_panels() enlarges a panel of this side, to 256 pixels or more.
int enlargement(int side);

// Image, render and their signed difference (render - image), over the level that is shown as
// white; squares, white around an image that is none.
PanelRow compared(std::span<const float> image, std::span<const float> render, int width,
                  int height, float white);

// Rows below one another, 8 white pixels between panels.
void write_panels(const std::filesystem::path& path, std::span<const PanelRow> rows);

// The bytes of a PNG file, not enlarged.
std::string encode_png(const Panel& panel);

}  // namespace itn
