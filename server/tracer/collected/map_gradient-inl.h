// The gradient in the pixels of a panorama (RenderRequest::gradient_light).
#if defined(ITN_TRACER_COLLECTED_MAP_GRADIENT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_MAP_GRADIENT_INL_H_
#undef ITN_TRACER_COLLECTED_MAP_GRADIENT_INL_H_
#else
#define ITN_TRACER_COLLECTED_MAP_GRADIENT_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>

#include "server/tracer/film/film_writer.h"
#include "server/tracer/lights/environment_map.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Light goes onto the film at once, by pixel of the panorama: a path keeps nothing of it.
class MapGradient {
 public:
  MapGradient(const Scene::Compiled& scene, const RenderRequest& request, FilmWriter& film)
      : map_(request.gradient_light ? scene.lights.map_of(*request.gradient_light) : nullptr),
        film_(film) {}

  bool asked() const { return map_ != nullptr; }

  // Light from `direction` arrives where `arrived` says, `per_radiance` of what is sent there, the
  // weight of the paths in `slots` included.
  void add(const UintColumn& pixels_of_paths, const UintColumn& samples, Vectors direction,
           Mask arrived, Floats per_radiance, Ints slots) {
    const MapPlace at = place_of(*map_, direction);
    const Floats left = 1 - at.fx, top = 1 - at.fy;
    const Ints pixels[] = {at.upper[0], at.upper[1], at.lower[0], at.lower[1]};
    const Floats shares[] = {left * top, at.fx * top, left * at.fy, at.fx * at.fy};
    alignas(64) int32_t slot[kMaxLanes], pixel[kMaxLanes];
    alignas(64) float part[kMaxLanes];
    hn::Store(slots, IntTag(), slot);
    for (size_t k = 0; k < 4; ++k) {
      hn::Store(pixels[k], IntTag(), pixel);
      hn::Store(per_radiance * shares[k], FloatTag(), part);
      for (Bits bits = bits_of(arrived); bits != 0; bits &= bits - 1) {
        const auto lane = static_cast<size_t>(std::countr_zero(bits));
        film_.add_to_map(pixels_of_paths[slot[lane]], samples[slot[lane]],
                         static_cast<size_t>(pixel[lane]), double{part[lane]});
      }
    }
  }

 private:
  const EnvironmentMap* map_;
  FilmWriter& film_;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
