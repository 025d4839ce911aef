// What is asked of a render, and how it goes about it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/material.h"
#include "common/render_limits.h"
#include "server/tracer/parameters/parameter.h"
#include "server/tracer/phase/phase_function.h"
#include "server/tracer/scene/scene.h"

namespace itn::tracer {

// How paths are traced: many at a time in stages, or one after the other through Embree. The second
// is plain path tracing, and the first is tested against it: the same integrals, other estimators;
// what they share is the random numbers, the light sources, the scene's compiled form and the film.
enum class Tracer { kWavefront, kReference };

// Which pixels are rendered. Those of the object are the ones that one of 4 x 4 camera rays, spread
// evenly over the pixel, shows to see it; all others stay 0.
enum class Pixels { kAll, kObject };

// A rectangle of pixels of the film.
struct Tile {
  uint32_t x = 0, y = 0;  // of the pixel at its left, top
  uint32_t width = 0, height = 0;
};

// What is asked for: the result depends on scene and request (and on Tuning and Switches, which are
// the same for everybody but tests and benchmarks).
struct RenderRequest {
  Material material;
  // Instead of Henyey and Greenstein's with material.g, which does not matter then.
  std::optional<PhaseFunction> phase = {};
  uint32_t sample_count = 16;  // per pixel, in [1, kMaxSamples]
  // The number of the first: a multiple of `estimates`; all below kMaxSamples.
  uint32_t first_sample = 0;
  // The part of the film that is rendered; nothing: all of it. Without a pilot, its pixels are
  // those of the whole, bit for bit. With one, samples are spread over the tile instead of the
  // film.
  std::optional<Tile> tile = {};
  uint64_t seed = 0;
  // Which derivative images to accumulate, in this order, none twice; of colours, three of each,
  // one after the other. At most kMaxDerivatives images.
  std::vector<Parameter> derivatives = {};
  // By pixel of the film, a weight of any sign, at most kMaxGradientWeight in size: instead of
  // derivative images, the gradient of the sum over the pixels of weight * radiance, a number for
  // each of `derivatives`. Empty: images.
  std::vector<float> gradient_weights = {};
  // Asks for its gradient in the pixels of this light, a panorama. Not by the reference.
  std::optional<uint32_t> gradient_light = {};
  // Asks for its gradient in the unit normals of the object's boundary, by triangle, corner and
  // coordinate: in its own coordinates, what is along the normal left out. Of a boundary that is
  // rough, under lights that have a size; not together with a derivative in its index, nor by the
  // reference.
  bool gradient_normals = false;
  // Sample i contributes to estimate i mod `estimates`, in [1, kMaxEstimates].
  uint32_t estimates = 1;
  Tracer tracer = Tracer::kWavefront;
  Pixels pixels = Pixels::kAll;
  // Albedos, at most that of the material, whose images are estimated from the same paths: where a
  // path of albedo a has weight a^n, it has weight b^n for b. At most kMaxAlbedos; not by the
  // reference.
  std::vector<double> albedos = {};
  // The medium in red, green and blue, for a scene whose film shows kRgb, and no other: sigma_t at
  // least, albedo at most that of the material, and its g. The images of the colours, and each of
  // the derivatives in them, are estimated from the same paths; `radiance` is their luminance.
  // There are no derivatives in lights and reflectances then (shares_paths), no albedos, no
  // gradient and no pilot; not by the reference.
  std::vector<Material> colours = {};
  // Samples per pixel of a pilot: an independent, coarse render of the same seed, whose samples are
  // not used in the image, but say where samples are needed and what control variate to subtract
  // (film/plan.h). 0: none. At most kMaxPilotSpp; not by the reference.
  uint32_t pilot_spp = 0;
  // By pixel, how much its noise matters, on any scale, >= 0: with a pilot, a pixel gets samples in
  // proportion to that times its standard deviation, and none for 0. Empty: all matter the same.
  std::vector<float> sampling_weights = {};
};

// How estimators are tuned: what makes the wavefront quicker or quieter. The defaults are measured.
struct Tuning {
  // Shadow rays that carry less than this fraction of the lights' mean radiance are decided by
  // roulette before they are traced. More is faster and noisier; 0 traces them all.
  double shadow_ray_roulette = 0.25;
  // Paths of less weight than this play roulette at every vertex. Below 0: 0.2 to 0.35, by what is
  // rendered.
  double walk_roulette = -1;
  // Paths deep in the medium count as of less weight there: the fraction of diffusion theory's
  // exponent for the fall-off of light with depth that is believed. 0: depth does not matter. Below
  // 0: 0.5 or 0.8, by what is rendered.
  double depth_roulette = -1;
  // Fraction of the pilot's radiance that multiplies the control variates of the derivatives in
  // sigma_t and g; 0: none.
  double control_variate = 0.85;
};

// What tests and benchmarks switch off, or put back to what path tracers usually do.
struct Switches {
  // One of the two direction sampling techniques that multiple importance sampling combines. Phase
  // sampling alone cannot see a DirectionalLight.
  enum class Techniques { kBoth, kLightsOnly, kPhaseOnly } techniques = Techniques::kBoth;
  // Instead of Tuning's roulette by weight and depth, ThroughputRoulette: walks as long as those of
  // the reference.
  bool throughput_roulette = false;
  // Low-discrepancy points for film position and first flight.
  bool stratified = true;
  // Samples where the pilot finds the noise; else as many in every pixel.
  bool adaptive = true;
  // Shadow rays through boundaries that are not deltas.
  bool refracted_shadow_rays = true;
};

// Roulette as path tracers usually play it, and the reference always: from this vertex on, paths
// survive with the probability of their weight. It is at most kMaxSurvival, but at boundaries:
// total internal reflection keeps light there for hundreds of crossings, after which a path that
// came through would be the one in millions that brings all that its like bring.
struct ThroughputRoulette {
  static constexpr uint32_t kFirstVertex = 20;
  static constexpr float kMaxSurvival = 0.95F;
};

struct RenderOptions {
  Tuning tuning = {};
  Switches switches = {};
  int threads = 0;  // 0: all; without influence on the result
};

PhaseFunction phase_of(const RenderRequest& request);
// Whether colours that share their paths have derivatives in it.
bool shares_paths(const Parameter& parameter);
// How many derivative images are accumulated.
size_t derivative_count(const RenderRequest& request);
// The slot of the boundary that is its index, if a derivative in that is asked for.
std::optional<size_t> differentiated_index(const RenderRequest& request, const Boundary& boundary);
double mean_cosine(const RenderRequest& request);
// How many the gradient has in the pixels of a panorama, and in normals. Of a valid request.
size_t gradient_numbers(const RenderRequest& request, const Scene& scene);

// Throws Error (invalid input) that names the field which is out of its range, as far as that does
// not depend on the scene: the one place where the ranges of a request are checked.
void validate(const RenderRequest& request);
// The same, and what depends on the scene: one sampling weight for each pixel, derivatives in
// parameters that it has.
void validate(const RenderRequest& request, const Scene& scene);

}  // namespace itn::tracer
