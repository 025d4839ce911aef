// An image of a scene in one channel, or in red, green and blue: which renders it takes, and what
// is to be said of it.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/render/render_query.h"
#include "client/render/render_rounds.h"
#include "common/material.h"
#include "itn/v1/render.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// The medium is a measured one, or has one number of each kind, or those of R, G and B.
struct ImageRequest {
  std::string medium;      // a measured one's name; then sigma_t, albedo and g follow from it
  double object_size = 0;  // with `medium`, the longest side of what the object stands for, in mm;
                           // 0: the object's own
  std::vector<double> sigma_t, albedo, g;  // no g: 0
  std::optional<v1::PhaseFunction> phase;  // instead of Henyey and Greenstein's with g
  bool colour = false;                     // channels R, G and B, instead of the film's
  // As in RenderQuery.
  uint32_t spp = 64;
  uint64_t seed = 0;
  uint32_t estimates = 1;
  uint32_t pilot_spp = 0;
  std::vector<std::string> derivatives;
  std::vector<SceneValue> values;
  v1::RenderedPixels pixels = v1::ALL_PIXELS;
  v1::Tracer tracer = v1::WAVEFRONT;
};

// Takes the medium or the materials that the scene's object has; false if it has none. Throws Error
// (invalid input) if there is no such measured medium.
bool take_medium(const v1::Scene& scene, ImageRequest& request);

// What is rendered for a channel of the image.
struct ImageChannel {
  std::string name;  // "Y", or "R", "G" and "B"
  v1::Film::Channel shown;
  Material material;
};

// Throws Error (invalid input) if there is no such measured medium.
std::vector<ImageChannel> channels_of(const ImageRequest& request, const v1::Scene& scene);

// One for each channel; or one for all, where that does what three do and costs less. Throws Error
// (invalid input) for a derivative that there is not, and as resolve_media() and serialize().
std::vector<RenderJob> jobs_of(const ImageRequest& request, const v1::Scene& scene,
                               std::span<const ImageChannel> channels);

// One reply for each channel, of those to the jobs.
std::vector<v1::RenderGradReply> replies_of(std::span<const ImageChannel> channels,
                                            std::vector<v1::RenderGradReply> replies);

// What `itn render` and itn.render call them: "all" or "object", "wavefront" or "reference". Throw
// Error (invalid input) for other words.
v1::RenderedPixels pixels_named(const std::string& word);
v1::Tracer tracer_named(const std::string& word);

// Of all renders together.
v1::Counters sum_of_counters(std::span<const v1::RenderGradReply> replies);

// The part of the image's pixels that the object covers. `mask`: that of a reply, not empty.
double coverage(std::span<const float> mask);

// For people: what may be wrong with the image, of so many samples, a sentence each. Throws Error
// (invalid input) if more than a hundredth of the paths that meet the object were dropped: that is
// no image of the scene. `counters`: of all renders.
std::vector<std::string> remarks_on(std::span<const ImageChannel> channels,
                                    std::span<const v1::RenderGradReply> replies,
                                    const v1::Counters& counters, const RenderGoal& goal,
                                    uint32_t spp);

}  // namespace itn
