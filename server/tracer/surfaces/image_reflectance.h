// The reflectances of an image, which is laid out again and again.
#ifndef ITN_TRACER_SURFACES_IMAGE_REFLECTANCE_H_
#define ITN_TRACER_SURFACES_IMAGE_REFLECTANCE_H_

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "server/tracer/colour/channel.h"
#include "server/tracer/surfaces/plane_coordinates.h"

namespace itn::tracer {

struct ImageReflectance {
  int width = 0, height = 0;                                   // in pixels
  std::shared_ptr<const std::vector<float>> values = nullptr;  // R, G, B of each, top row first;
                                                               // once it is compiled, one of them
  float scale = 1;
  Vec3d corner;                              // where the lower left corner of an image lies, in mm
  Vec3d edge_u{10, 0, 0}, edge_v{0, 0, 10};  // its lower side and its left one
  PlaneCoordinates plane = {};               // once it is compiled

  static constexpr const char* kName = "image";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("scale", self.scale, 0, 1);
    to.position("corner", self.corner);
    to.position("edge_u", self.edge_u);
    to.position("edge_v", self.edge_v);
    to.pixels("pixels", self);
  }
  size_t memory() const { return values->size() * sizeof(float); }
  ImageReflectance compile(const Pose& pose, Channel channel) const {
    ImageReflectance compiled = *this;
    compiled.plane = PlaneCoordinates(pose, kName, corner, edge_u, edge_v);
    std::vector<float> selected;
    selected.reserve(values->size() / 3);
    for (size_t i = 0; i < values->size(); i += 3) {
      const Rgb rgb{(*values)[i], (*values)[i + 1], (*values)[i + 2]};
      selected.push_back(static_cast<float>(select(rgb, channel)));
    }
    compiled.values = std::make_shared<const std::vector<float>>(std::move(selected));
    return compiled;
  }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_SURFACES_IMAGE_REFLECTANCE_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_SURFACES_IMAGE_REFLECTANCE_MATHS_
#undef ITN_TRACER_SURFACES_IMAGE_REFLECTANCE_MATHS_
#else
#define ITN_TRACER_SURFACES_IMAGE_REFLECTANCE_MATHS_
#endif

#include "server/tracer/simd/math-inl.h"
#include "server/tracer/surfaces/plane_coordinates.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The two pixels of a row, or rows of the image, between whose middles a coordinate lies, and how
// far it is from the first one to the other. They are in the image even for NaN, where paths are
// that have escaped.
struct Between {
  Ints first, second;
  Floats part;
};
HWY_INLINE Between between(Floats coordinate, int size) {
  const IntTag di;
  const Floats place = (coordinate - hn::Floor(coordinate)) * static_cast<float>(size) - 0.5F;
  const Floats below = hn::Floor(place);
  const Ints i = to_int(below), last = hn::Set(di, size - 1), zero = hn::Zero(di);
  const Ints next = i + hn::Set(di, 1);
  return {hn::IfThenElse(i < zero, last, hn::Min(i, last)),
          hn::IfThenElse(next > last, zero, hn::Max(next, zero)), place - below};
}

// Bilinear between the middles of pixels.
HWY_INLINE Floats reflectance_slope(const ImageReflectance& image, size_t /*slot*/, Vectors p) {
  const PlanePoint at = coordinates_of(image.plane, p);
  const Between x = between(at.u, image.width), y = between(-at.v, image.height);
  const float* const values = image.values->data();
  const Ints width = hn::Set(IntTag(), image.width);
  const auto row = [&](Ints number) {
    const Ints begin = number * width;
    return mix(gather(values, begin + x.first), gather(values, begin + x.second), x.part);
  };
  return mix(row(y.first), row(y.second), y.part);
}
HWY_INLINE Floats reflectance_at(const ImageReflectance& image, Vectors p) {
  return reflectance_slope(image, 0, p) * image.scale;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
