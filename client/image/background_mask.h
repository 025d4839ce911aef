// Finds where the object is in a photograph of it before a plain background.
#pragma once

#include <span>
#include <vector>

namespace itn {

// A mask of the object, 1 on it and 0 elsewhere, width * height values with the top row first:
// roughly, to a pixel or two of an image of 512. The background, which the border of the photograph
// shows, may change smoothly, as under one lamp, and may be lighter or darker than the object.
//
// Shadows are told from the object by their colour, if the object has another than the background;
// else they may be taken for a part of it.
//
// `pixels` are linear, of any scale, 1 or 3 channels interleaved, top row first. Always the same
// for the same photograph. By GrabCut (Rother, Kolmogorov and Blake, SIGGRAPH 2004). Throws Error
// (invalid input) if there is nothing that could be an object: what differs from the border is less
// than 0.5 % of the photograph, or lies along most of its border.
std::vector<float> mask_from_background(int width, int height, int channels,
                                        std::span<const float> pixels);

}  // namespace itn
