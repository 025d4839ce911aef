// The scene of an item.
#pragma once

#include "itn/v1/dataset.pb.h"

namespace itn {

// `triangles`: the item's shape, as the file in a dataset has it. `resolution`: pixels a side.
// `panorama`: likewise, where one lights the item.
v1::Scene scene_of(const v1::DatasetItem& item, const v1::Triangles& triangles, uint32_t resolution,
                   const v1::Pixels* panorama = nullptr);

}  // namespace itn
