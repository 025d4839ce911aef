// The renderer: an image of a scene and its derivatives with respect to the material, by path
// integration with score functions (Che et al., ICCP 2020, Eqs. 4-7).
#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "common/material.h"
#include "server/tracer/scene/scene.h"

namespace itn::tracer {

// The coordinates that derivatives are accumulated in; others follow by the chain rule.
enum Coordinate { kSigmaT, kAlbedo, kG, kCoordinates };

// How paths are traced: many at a time in stages, or one after the other through Embree. The second
// is plain path tracing, and the first is tested against it: the same integrals, other estimators,
// no shared code but the random numbers and the tables of the lights.
enum class Tracer { kWavefront, kReference };

// Which pixels are rendered. Those of the object are the ones that one of 4 x 4 camera rays, spread
// evenly over the pixel, shows to see it; all others stay 0.
enum class Pixels { kAll, kObject };

// Roulette as path tracers usually play it, and the reference always: from this vertex on, paths
// survive with the probability of their weight, at most this.
struct UsualRoulette {
  static constexpr uint32_t kFirstVertex = 20;
  static constexpr float kMostSurvival = 0.95F;
};

// More radiances of one render (RenderSettings::albedos).
constexpr size_t kMaxAlbedos = 16;

struct RenderSettings {
  Material material;
  // Samples per pixel are numbered 0 .. spp-1; those in [first_sample, first_sample + sample_count)
  // are rendered.
  uint32_t first_sample = 0;
  uint32_t sample_count = 16;
  // The number spp of the whole, which a part is a part of; it matters with a pilot only. 0:
  // first_sample + sample_count.
  uint32_t spp = 0;
  uint64_t seed = 0;
  bool derivatives = false;
  // Sample i contributes to estimate i mod `estimates`, in [1, 16].
  uint32_t estimates = 1;
  Tracer tracer = Tracer::kWavefront;
  Pixels pixels = Pixels::kAll;
  // Albedos, at most that of the material, whose images are estimated from the same paths: where a
  // path of albedo a has weight a^n, it has weight b^n for b. At most kMaxAlbedos; not by the
  // reference.
  std::vector<double> albedos = {};
  // Samples per pixel of a pilot: an independent, coarse render of the same seed, whose samples are
  // not used in the image, but say where samples are needed and what baseline to subtract
  // (plan.h). 0: none. At most 64; not by the reference.
  uint32_t pilot_spp = 0;
  // By pixel, how much its noise matters, on any scale, >= 0: with a pilot, a pixel gets samples in
  // proportion to that times its standard deviation, and none for 0, if they are adaptive. Empty:
  // all matter the same.
  std::vector<float> importance = {};

  // Switches off one of the two direction sampling techniques that multiple importance sampling
  // combines, for tests. Phase sampling alone cannot see a DirectionalBeam.
  enum class Techniques { kBoth, kLightsOnly, kPhaseOnly } techniques = Techniques::kBoth;
  // What makes the wavefront quicker or quieter, each to be switched off for tests and benchmarks.
  // Connections to the light that carry less than this fraction of the lights' mean radiance are
  // decided by roulette before they are traced. More is faster and noisier; 0 traces them all.
  double connection_roulette = 0.25;
  // Paths of less weight than this play roulette at every vertex. Below 0: 0.2 to 0.35, by what is
  // rendered.
  double walk_roulette = -1;
  // Paths deep in the medium count as of less weight there: the fraction of diffusion theory's
  // exponent for the fall-off of light with depth that is believed. 0: depth does not matter. Below
  // 0: 0.5 or 0.8, by what is rendered.
  double depth_roulette = -1;
  // Instead of these two, UsualRoulette: walks as long as those of the reference.
  bool usual_roulette = false;
  // Low-discrepancy points for film position and first flight.
  bool stratified = true;
  // Fraction of the pilot's radiance that is the baseline of the derivatives; 0: no baseline.
  double baseline = 0.85;
  // Samples where the pilot finds the noise; else as many in every pixel.
  bool adaptive = true;

  // Threads; 0: all.
  int threads = 0;
};

// What happened. `invalid_samples` and `leaks` are dropped (they count as 0 radiance).
struct Counters {
  uint64_t paths = 0;
  uint64_t steps = 0;  // free flights inside the medium
  uint64_t invalid_samples = 0;
  uint64_t leaks = 0;
  double cpu_seconds = 0;
};

// Sums over samples in fixed point: value = integer * quantum. Integer sums have no order, so they
// do not depend on threads or tiles, and the sums of parts are the sums of the whole.
struct FilmSums {
  int width = 0;
  int height = 0;
  uint32_t first_sample = 0;
  uint32_t sample_count = 0;
  double quantum = 0;          // of radiance; a power of two
  double squares_quantum = 0;  // of squares
  std::array<double, kCoordinates> derivative_quanta{};

  struct EstimateSums {
    std::vector<uint32_t> counts;  // of samples
    std::vector<int64_t> radiance;
    std::array<std::vector<int64_t>, kCoordinates> derivatives;  // empty if not asked
    std::vector<std::vector<int64_t>> at_albedos;  // radiance for RenderSettings::albedos
  };
  std::vector<EstimateSums> estimates;
  std::vector<int64_t> squares;  // of radiance, over all estimates; each at most 2^42 quanta
  std::vector<int64_t> hits;     // camera rays that meet the object
  Counters counters;
};

// Adds the sums of an adjacent or disjoint range of samples of the same render. Throws Error
// (internal) if the sizes, quanta or estimates differ.
void merge(FilmSums& into, const FilmSums& part);

// Number of the samples in [first, first + count) that belong to estimate k of K.
uint64_t samples_of_estimate(uint32_t first, uint32_t count, uint32_t k, uint32_t estimates);

// Means over the samples, 0 where there are none; all arrays width * height, top row first.
struct RenderedImages {
  struct Estimate {
    std::vector<float> radiance;
    std::array<std::vector<float>, kCoordinates> derivatives;  // empty if not asked
    std::vector<std::vector<float>> at_albedos;
  };
  std::vector<Estimate> estimates;
  std::vector<float> mask;            // fraction of camera rays that meet the object
  std::vector<float> standard_error;  // of the mean radiance over all samples; 0 for less than two
};

RenderedImages means(const FilmSums& sums);

// Renders. The result depends on the scene and the settings but for `threads`, bit for bit; the
// random numbers of a sample depend on (seed, pixel, sample) alone. Returns within a few
// milliseconds after a stop is requested, by throwing Error (cancelled).
FilmSums render_grad(const Scene& scene, const RenderSettings& settings, std::stop_token stop = {});

}  // namespace itn::tracer
