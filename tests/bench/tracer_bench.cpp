// Speed of the tracer and of the service around it. tests/bench/run.sh runs this interleaved and
// prints medians and ratios.
//
// "plain" is the oracle: Embree, every connection traced. "standard" is what a worker renders with.
#include <benchmark/benchmark.h>

#include <array>
#include <memory>
#include <string>

#include "client/render_pool.h"
#include "common/shapes.h"
#include "server/render_server.h"
#include "server/tracer/render.h"

namespace itn {
namespace {

using namespace tracer;

struct MaterialRow {
  const char* name;
  Material material;
};
constexpr std::array kMaterials = {MaterialRow{"30,.39,0", {30, 0.39, 0}},
                                   MaterialRow{"100,.87,.4", {100, 0.87, 0.4}},
                                   MaterialRow{"276,.95,.8", {276, 0.95, 0.8}}};
constexpr std::array kShapes = {"sphere", "smooth_star", "mug", "leaf"};

struct Variant {
  const char* name;
  IntersectorKind intersector;
  double connection_roulette;
};
constexpr std::array kVariants = {Variant{"plain", IntersectorKind::kEmbree, 0},
                                  Variant{"standard", IntersectorKind::kEmbree, 0.1},
                                  Variant{"grid", IntersectorKind::kGrid, 0.1}};

// The paper's set-up: the object on the ground under sun and sky, seen from 34 mm.
SceneDescription paper_scene(const std::string& shape, IntersectorKind intersector) {
  SceneDescription scene;
  scene.object = make_shape(shape);
  scene.surfaces.push_back(
      {{{{-20, 0, -20}, {-20, 0, 20}, {20, 0, 20}, {20, 0, -20}}, {{0, 1, 2}, {0, 2, 3}}}, 0.5F});
  SunSkyLight light;
  light.sun_angular_radius = 0.327;
  scene.lights = {light};
  const double middle = static_cast<double>(bounds(scene.object).max.y) / 2;
  scene.camera = {.origin = {0, middle + 8.78, -32.8}, .target = {0, middle, 0}, .fov = 0.0436};
  scene.film = {64, 64, Channel::kLuminance};
  scene.intersector = intersector;
  return scene;
}

// One render on one thread. Reports walk steps per CPU-second, and the variance of an object pixel
// times CPU time (relative to the mean squared): what equal error costs.
void render(benchmark::State& state, const std::string& shape, const Material& material,
            const Variant& variant, bool derivatives) {
  const Scene scene(paper_scene(shape, variant.intersector));
  RenderSettings settings{.material = material,
                          .sample_count = 16,
                          .derivatives = derivatives,
                          .connection_roulette = variant.connection_roulette,
                          .threads = 1};
  double steps = 0, cpu = 0, error = 0;
  for (auto _ : state) {
    ++settings.seed;
    const FilmSums sums = render_grad(scene, settings);
    steps += static_cast<double>(sums.counters.steps);
    cpu += sums.counters.cpu_seconds;
    const RenderedImages images = means(sums);
    double variance = 0, radiance = 0;
    for (size_t p = 0; p < images.mask.size(); ++p) {
      if (images.mask[p] > 0.99F) {
        variance += static_cast<double>(images.standard_error[p]) * images.standard_error[p];
        radiance += images.estimates[0].radiance[p];
      }
    }
    error += variance / (radiance * radiance);
  }
  const auto n = static_cast<double>(state.iterations());
  state.counters["steps_per_cpu_second"] = steps / cpu;
  state.counters["error_times_cpu"] = error / n * cpu / n;
}

// The same call, to a worker inside the process or behind a port of the loopback.
void call(benchmark::State& state, bool remote) {
  static RenderServer server({.listen = "127.0.0.1:0", .reflection = false, .service = {}});
  RenderPool pool({.workers = remote ? std::vector<std::string>{server.address()}
                                     : std::vector<std::string>{}});
  v1::Scene scene;
  scene.mutable_object()->mutable_mesh()->set_builtin("smooth_star");
  scene.add_lights()->mutable_sun_sky()->set_sun_angular_radius_degrees(18.75F);
  auto& camera = *scene.mutable_camera();
  camera.mutable_origin()->set_y(9.28F);
  camera.mutable_origin()->set_z(-32.8F);
  camera.mutable_target()->set_y(0.5F);
  camera.set_fov_degrees(2.5F);
  scene.mutable_film()->set_width(128);
  scene.mutable_film()->set_height(128);
  RenderJob job{serialize(scene), {}};
  job.request.mutable_material()->set_sigma_t(100);
  job.request.mutable_material()->set_albedo(0.87);
  job.request.mutable_material()->set_g(0.4);
  job.request.set_spp(16);
  job.request.set_estimates(2);
  for (const v1::Parameter p : {v1::SIGMA_T, v1::ALBEDO, v1::G}) {
    job.request.add_derivatives(p);
  }
  pool.submit(job).get();  // sends the scene
  for (auto _ : state) {
    job.request.set_seed(job.request.seed() + 1);
    benchmark::DoNotOptimize(pool.submit(job).get());
  }
}

void register_all() {
  for (const char* shape : kShapes) {
    for (const MaterialRow& row : kMaterials) {
      const std::string scene = std::string(shape) + " " + row.name;
      for (const Variant& variant : kVariants) {
        benchmark::RegisterBenchmark((scene + "/" + variant.name).c_str(), render, shape,
                                     row.material, variant, true)
            ->Unit(benchmark::kMillisecond);
      }
      benchmark::RegisterBenchmark((scene + "/image only").c_str(), render, shape, row.material,
                                   kVariants[1], false)
          ->Unit(benchmark::kMillisecond);
    }
  }
  benchmark::RegisterBenchmark("call/embedded", call, false)
      ->Unit(benchmark::kMillisecond)
      ->UseRealTime();
  benchmark::RegisterBenchmark("call/remote", call, true)
      ->Unit(benchmark::kMillisecond)
      ->UseRealTime();
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::register_all();
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
}
