// Paths in stages: every path of the wavefront flies, then all interact, then all shadow rays are
// traced, and so on. The algorithm is that of reference/path.cpp, where the estimators are derived;
// what is added here to make it quicker or quieter is derived where it stands.
//
// The words of this folder:
//   path        a random walk from the camera to the light, and what it has collected so far: a
//               sample of a pixel (PathSample)
//   vertex      where a path scatters, is reflected or is refracted; the camera is vertex 0
//   slot        the number of a path while it is under way; when it ends, another takes its slot
//   column      one number for every slot (columns.h): what is known of a path stands in the same
//               slot of many columns (paths.h)
//   lane        an instruction works on as many neighbouring slots as the processor has lanes: `i`
//               is the first of these slots, and a Mask says which lanes are meant
//   wavefront   the paths under way, in slots 0 .. count - 1, and what they go through
//               (state-inl.h)
//   stage       a function that takes all paths a step further; they are called in Walk::run
//   flight      the straight way of a path to its next vertex, through a length in the medium that
//               is drawn beforehand (flight-inl.h)
//   shadow ray  the straight way from a vertex to a light, whose light it brings
//               (shadow_rays-inl.h)
//   refracted shadow ray  one that is sent towards the boundary, which bends it to a light
//               (refracted_rays-inl.h)
//   ray, line   a ray is a straight way that is asked for, by a flight or to a light (rays.h); a
//               line is what follows it, one of a few (lines/follow-inl.h)
//   weight W    what light at the end of the path counts: the product of the factors along it
//   score       the derivative of the logarithm of the path's density by a parameter
//   boundary turn  where a path crosses the boundary, or is reflected there: it is remembered for
//               a gradient in normals (collected/normal_gradient.h)
//   delta bounce  the last vertex draws no shadow ray: light ahead counts whole
//   colour      one of the media of a request whose images share their paths
//   likelihood  the density of a path in a colour, over the mean of all of them (colours-inl.h)
//
// It is compiled for every instruction set of simd/targets.h, and chosen at run time.
// Multiplications and additions are fused where the code says so, not where the compiler likes
// (-ffp-contract=off), so that every width computes the same bits.
#include "server/tracer/simd/targets.h"
// After targets.h:
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/tracer/wavefront/wavefront.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h:
#include <hwy/highway.h>

#include <cstddef>
#include <memory>
#include <stop_token>

#include "common/error.h"
#include "server/tracer/simd/denormals.h"
#include "server/tracer/wavefront/walk/begin-inl.h"
#include "server/tracer/wavefront/walk/contribution-inl.h"
#include "server/tracer/wavefront/walk/flight-inl.h"
#include "server/tracer/wavefront/walk/outline_rays-inl.h"
#include "server/tracer/wavefront/walk/refracted_rays-inl.h"
#include "server/tracer/wavefront/walk/refraction_odds-inl.h"
#include "server/tracer/wavefront/walk/roulette-inl.h"
#include "server/tracer/wavefront/walk/scatter-inl.h"
#include "server/tracer/wavefront/walk/shadow_rays-inl.h"
#include "server/tracer/wavefront/wavefront.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// What happens at the ends of the flights: light is met, or the path is scattered,
// reflected or refracted.
inline void interact(Wavefront& wavefront) {
  Paths& paths = wavefront.paths;
  wavefront.shadow_rays.count = wavefront.refracted_rays.count = 0;
  wavefront.aimed_again.count = wavefront.odds_rays.count = wavefront.shadow_odds.count = 0;
  const auto end_of = [&](size_t i) { return load(paths.rays.outcome, i) & set(Rays::kEndMask); };
  SlotList escaped;
  for (size_t i = 0; i < wavefront.count; i += lanes()) {
    const Mask live = hn::FirstN(FloatTag(), wavefront.count - i);
    const Uints end = end_of(i);
    update_scores(wavefront, i, equals(end, Rays::kInMedium));
    escaped.add(i, live & equals(end, Rays::kEscaped));
  }
  escaped.for_each([&](Ints slots, Mask live) { add_emission(wavefront, slots, live); });
  for (size_t i = 0; i < wavefront.count; i += lanes()) {
    const Mask live = hn::FirstN(FloatTag(), wavefront.count - i);
    const Uints end = end_of(i), one = set(uint32_t{1}), none = hn::Zero(UintTag());
    const Mask scattered = equals(end, Rays::kInMedium), surface = equals(end, Rays::kSurface);
    const Mask crossed = equals(end, Rays::kCrossing);
    const Mask goes_on = scattered | surface | crossed;
    store(hn::IfThenElse(for_uints(equals(end, Rays::kLeaked)), one, none), paths.leaked, i);
    store(hn::IfThenElse(for_uints(goes_on), one, none), paths.alive, i);
    if (!hn::AllFalse(FloatTag(), live & goes_on)) {
      scatter(wavefront, i, live & scattered, live & surface, live & crossed);
    }
  }
}

// One thread's walk through the samples of a queue.
class Walk {
 public:
  Walk(const Scene::Compiled& scene, const RenderRequest& request, const RenderOptions& options,
       WorkQueue& queue, FilmWriter& film)
      : wave_(scene, request, options, film),
        roulette_(scene, request, options.tuning),
        source_(scene, request, options.switches, queue) {}

  void run(const std::stop_token& stop) {
    std::optional<NormalGradient>& normals = wave_.collected.normal_gradient;
    fill();
    while (wave_.count > 0) {
      if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "the render was stopped");
      sample_flights(wave_);
      interact(wave_);
      if (wave_.refracts_shadow_rays) {
        cross_refracted_rays(wave_);
        check_odds(wave_);
      }
      trace_shadow_rays(wave_);
      trace_outline_rays(wave_);
      if (normals) normals->note_radiance(wave_.paths.radiance);
      russian_roulette(wave_, roulette_);
      finish();
    }
  }

 private:
  void fill() {
    while (wave_.count < kSlots && source_.begin_path(wave_, wave_.count)) ++wave_.count;
  }

  // Records paths that have ended, and puts new ones in their place; where there are no more, the
  // last path moves there.
  void finish() {
    std::optional<NormalGradient>& normals = wave_.collected.normal_gradient;
    for (size_t slot = wave_.count; slot-- > 0;) {
      const Paths& paths = wave_.paths;
      if (paths.alive[slot] != 0) continue;
      record(slot);
      if (normals && paths.leaked[slot] == 0) {
        normals->add_to_film(paths.pixel[slot], paths.sample[slot], slot, paths.radiance[slot]);
      }
      if (source_.begin_path(wave_, slot)) continue;
      --wave_.count;
      if (slot != wave_.count) wave_.move(wave_.count, slot);
    }
  }

  // Adds what a path has collected to the film.
  void record(size_t slot) {
    const Paths& paths = wave_.paths;
    const PathSample sample{paths.pixel[slot], paths.sample[slot], paths.expected[slot]};
    estimate_.hit = paths.hit[slot] != 0;
    estimate_.leaked = paths.leaked[slot] != 0;
    estimate_.steps = paths.steps[slot];
    estimate_.radiance = paths.radiance[slot];
    wave_.collected.record(slot, sample.expected, estimate_);
    wave_.film.add(sample, estimate_);
  }

  Wavefront wave_;
  const WalkRoulette roulette_;
  PathSource source_;
  PathEstimate estimate_;  // of the path that is recorded
};

void run_wavefront(const Scene::Compiled& scene, const RenderRequest& request,
                   const RenderOptions& options, WorkQueue& queue, FilmWriter& film,
                   const std::stop_token& stop) {
  // Colours that a path is hardly of have tiny weights.
  const DenormalsAsZero as_zero;
  std::make_unique<Walk>(scene, request, options, queue, film)->run(stop);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace itn::tracer {

HWY_EXPORT(run_wavefront);

void trace_wavefront(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, WorkQueue& queue, FilmWriter& film,
                     const std::stop_token& stop) {
  HWY_DYNAMIC_DISPATCH(run_wavefront)(scene, request, options, queue, film, stop);
}

}  // namespace itn::tracer
#endif
