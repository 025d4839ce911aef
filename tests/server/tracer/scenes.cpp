#include "tests/server/tracer/scenes.h"

#include <algorithm>
#include <map>
#include <utility>

namespace itn::testing {

using namespace tracer;

Mesh box(Vec3f a, Vec3f b) {
  return {{{a.x, a.y, a.z},
           {b.x, a.y, a.z},
           {b.x, b.y, a.z},
           {a.x, b.y, a.z},
           {a.x, a.y, b.z},
           {b.x, a.y, b.z},
           {b.x, b.y, b.z},
           {a.x, b.y, b.z}},
          {{0, 2, 1},
           {0, 3, 2},
           {4, 5, 6},
           {4, 6, 7},
           {0, 1, 5},
           {0, 5, 4},
           {3, 6, 2},
           {3, 7, 6},
           {0, 4, 7},
           {0, 7, 3},
           {1, 2, 6},
           {1, 6, 5}}};
}

Mesh horizontal_square(float y, float half_size) {
  const float s = half_size;
  return {{{-s, y, -s}, {-s, y, s}, {s, y, s}, {s, y, -s}}, {{0, 1, 2}, {0, 2, 3}}};
}

Mesh sphere_of_triangles() {
  Mesh mesh = {
      {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}},
      {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}}};
  for (int level = 0; level < 4; ++level) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto number = static_cast<uint32_t>(mesh.vertices.size());
      const auto [found, is_new] = middles.try_emplace(std::minmax(a, b), number);
      if (is_new) mesh.vertices.push_back(itn::normalize(mesh.vertices[a] + mesh.vertices[b]));
      return found->second;
    };
    const auto before = std::move(mesh.triangles);
    mesh.triangles.clear();
    for (const auto& [a, b, c] : before) {
      const uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      mesh.triangles.insert(mesh.triangles.end(),
                            {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
  }
  return mesh;
}

SceneDescription studio(const std::string& shape, std::vector<LightDescription> lights,
                        float ground, int resolution) {
  SceneDescription scene;
  scene.object = make_shape(shape);
  const Bounds box = bounds(scene.object);
  if (ground >= 0) scene.surfaces.push_back({horizontal_square(0, 20), ground});
  scene.lights = std::move(lights);
  const double middle = static_cast<double>(box.max.y) / 2;
  scene.camera.origin = {0, middle + 8.78, -32.8};
  scene.camera.target = {0, middle, 0};
  scene.camera.fov = 0.9 / 34;  // 0.9 mm at the object
  scene.film = {resolution, resolution, Channel::kLuminance};
  return scene;
}

SunSkyLight paper_sun_sky(double azimuth) {
  SunSkyLight light;
  light.sun_azimuth = azimuth;
  light.sun_angular_radius = 18.75 * 0.017453292519943295;
  return light;
}

double film_mean(const FilmSums& sums, int layer, size_t k) {
  const auto& estimate = sums.estimates[k];
  const auto& values =
      layer < 0 ? estimate.radiance : estimate.derivatives[static_cast<size_t>(layer)];
  const double quantum =
      layer < 0 ? sums.quantum : sums.derivative_quanta[static_cast<size_t>(layer)];
  double sum = 0;
  for (size_t p = 0; p < values.size(); ++p) {
    if (estimate.counts[p] > 0) sum += static_cast<double>(values[p]) / estimate.counts[p];
  }
  return sum * quantum / static_cast<double>(values.size());
}

FilmEstimate estimate_film(const Scene& scene, RenderRequest request, int batches,
                           uint64_t first_seed, const RenderOptions& options) {
  std::vector<double> radiance;
  std::vector<std::vector<double>> derivatives(request.derivatives.size());
  FilmEstimate result;
  for (int b = 0; b < batches; ++b) {
    request.seed = first_seed + static_cast<uint64_t>(b);
    const FilmSums sums = render_grad(scene, request, options);
    radiance.push_back(film_mean(sums, -1));
    for (size_t i = 0; i < derivatives.size(); ++i) {
      derivatives[i].push_back(film_mean(sums, static_cast<int>(i)));
    }
    add(result.counters, sums.counters);
  }
  result.radiance = over_batches(radiance);
  for (const std::vector<double>& derivative : derivatives) {
    result.derivatives.push_back(over_batches(derivative));
  }
  return result;
}

void expect_same_film(const FilmEstimate& a, const FilmEstimate& b, int comparisons,
                      const std::string& what, const std::vector<double>& scales) {
  expect_equal(a.radiance, b.radiance, comparisons, what);
  expect_resolution(difference(a.radiance, b.radiance), b.radiance.mean, 0.02, what);
  ASSERT_EQ(a.derivatives.size(), b.derivatives.size());
  for (size_t i = 0; i < a.derivatives.size(); ++i) {
    const Estimated &x = a.derivatives[i], &y = b.derivatives[i];
    const std::string name = what + ", derivative " + std::to_string(i);
    expect_equal(x, y, comparisons, name);
    const double scale = i < scales.size() && scales[i] > 0 ? scales[i] : y.mean;
    expect_resolution(difference(x, y), scale, 0.02, name);
  }
}

}  // namespace itn::testing
