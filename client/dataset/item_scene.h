// The scene of an item.
#pragma once

#include <array>
#include <string>

#include "itn/v1/dataset.pb.h"

namespace itn {

// Whether a scene can be made of an item, which may come from a stranger: throws Error (invalid
// input) that names the field, below `path`, that is not finite, or out of the range in which
// DatasetConfig draws it where that would take unbounded time or memory. Other ranges are checked
// where the scene is built.
void check_item(const v1::DatasetItem& item, const std::string& path);

// Whether some of a lamp may be in the picture that a camera takes, of a scene without anything
// else.
bool may_be_seen(const v1::Lamp& lamp, const v1::ItemCamera& camera);

// What a white card shows of what lights an item: irradiance in red, green and blue, over the
// irradiance that the item says, to which a flash and a lamp add what the room sends. The card
// faces up; below a lamp or a flash it faces that, and a studio's emitters each by itself.
// `panorama` as below. Throws Error (invalid input) if there is none in some colour.
std::array<double, 3> white_of(const v1::DatasetItem& item, const v1::Pixels* panorama = nullptr);

// The scene of an item that check_item() lets pass. `triangles`: its shape, as the file in a
// dataset has it. `resolution`: pixels a side. `panorama`: likewise, where one lights the item.
v1::Scene scene_of(const v1::DatasetItem& item, const v1::Triangles& triangles, uint32_t resolution,
                   const v1::Pixels* panorama = nullptr);

}  // namespace itn
