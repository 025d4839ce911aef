// Media in red, green and blue, as datasets draw them.
#pragma once

#include <array>

#include "client/dataset/choices.h"
#include "common/material.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// The medium in each colour by what is drawn of green. `materials` is valid and has `colours`.
std::array<Material, 3> draw_colours(const v1::MaterialChoice& materials, const Material& green,
                                     const Choices& choices);

}  // namespace itn
