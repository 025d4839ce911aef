// The gradient in the normals of the boundary (RenderRequest::gradient_normals): by triangle of the
// object, in its three corners' normals. Normals between them are their mean by barycentric
// coordinates, of unit length.
//
// What a path collects depends on the normal wherever it crosses the boundary, by the score of the
// crossing: the derivative is that times the light that the path collects behind it. So a path
// remembers its turns until it ends.
#pragma once

#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

#include "common/vec.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

// The derivative of the logarithm of a path's weight in the normal at a place of the boundary,
// which faces outwards.
struct NormalScore {
  uint32_t triangle;
  Vec3f place, score;
};

// A point where a path has crossed the boundary or was reflected there.
struct BoundaryTurn {
  NormalScore normal;
  bool edge;           // whether an edge was followed (BoundaryEdge): nothing counts behind it but
                       // what that edge brings
  float radiance = 0;  // that was collected before
};

class NormalGradient {
 public:
  NormalGradient(const Scene::Compiled& scene, FilmWriter& film)
      : scene_(scene), film_(film), turns_(kSlots) {}

  // The path in a slot turns.
  void note(size_t slot, const NormalScore& normal, bool edge) {
    turns_[slot].push_back({normal, edge});
    turned_.push_back(slot);
  }
  // What paths had collected before their new turns, once all shadow rays are traced.
  void note_radiance(const FloatColumn& radiance);

  // The light that edges bring.
  FloatColumn& edge_radiance() { return edge_radiance_; }
  auto columns() { return std::tie(edge_radiance_); }
  void begin(size_t slot) { turns_[slot].clear(); }
  void move(size_t from, size_t to) { turns_[to].swap(turns_[from]); }

  // Light that reaches the pixel of a sample.
  void add(uint32_t pixel, uint32_t sample, const NormalScore& at, double light);
  // Adds to the film what the path in a slot, which has ended, has collected.
  void add_to_film(uint32_t pixel, uint32_t sample, size_t slot, float radiance);

 private:
  const Scene::Compiled& scene_;
  FilmWriter& film_;
  std::vector<std::vector<BoundaryTurn>> turns_;  // by slot
  std::vector<size_t> turned_;                    // slots whose last turn is new
  FloatState<> edge_radiance_{};
};

}  // namespace itn::tracer
