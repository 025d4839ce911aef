// What is left to tell of a material once all that similar ones share is known.
#pragma once

#include <optional>
#include <vector>

#include "client/training/training_set.h"
#include "common/material.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// The best answers of one who knows sigma_t* and albedo* of each image exactly (SIMILARITY in
// common/learning/parameterization.h), what the materials were drawn from, and nothing else: the
// mean of all materials that share them. Deep inside of an object such materials scatter alike, and
// their images nearly agree: a network with smaller errors has told similar materials apart. None
// unless sigma_t, albedo and g are drawn from intervals, independently.
std::optional<std::vector<Material>> similarity_predictions(const LabelledImages& images,
                                                            const v1::MaterialChoice& materials);

}  // namespace itn
