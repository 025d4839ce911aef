// Media in red, green and blue, as datasets draw them.
#pragma once

#include <array>

#include "client/dataset/choices.h"
#include "common/material.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// What says how dense media are: sigma_s_reduced, or sigma_t.
const v1::Distribution& density_of(const v1::MaterialChoice& materials);

// The medium of that density.
Material medium_of(const v1::MaterialChoice& materials, double density, double albedo, double g);

// The medium in each colour by what is drawn of green. `materials` is valid and has `colours`.
std::array<Material, 3> draw_colours(const v1::MaterialChoice& materials, const Material& green,
                                     const Choices& choices);

}  // namespace itn
