// What a material looks like by itself: without the shape and the light of a photograph.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>

#include "client/render/job_renderer.h"
#include "common/material.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// The colour of a sphere of 1 mm under white light from all sides: the mean of what it sends to a
// camera far away, over what a white thing that absorbs nothing would send. `colours`: its medium
// in red, green and blue. `boundary`: its surface, if it has one.
std::array<double, 3> sphere_colour(JobRenderer& pool, std::span<const Material> colours,
                                    const std::optional<v1::RoughDielectric>& boundary,
                                    uint32_t spp, uint64_t seed, std::stop_token stop = {});

}  // namespace itn
