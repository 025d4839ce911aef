// Real renders: the truth is found within what is stated.
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "client/refine/refinement.h"
#include "client/render_pool/render_pool.h"
#include "client/scene/text_proto.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"
#include "tests/support/statistics.h"

namespace itn {
namespace {

using testing::expect_equal;

constexpr const char* kScene = R"(
object { mesh { builtin: "urchin" normalize: true } }
lights { constant { radiance: 1 } }
lights { directional { direction { x: 1 y: 1 z: -0.5 } irradiance: 3 } }
camera { origin { y: 9.28 z: -32.8 } target { y: 0.5 } fov_degrees: 2.5 }
film { width: 40 height: 40 }
)";

v1::Scene scene_of_text(const char* text) {
  v1::Scene scene;
  parse_text_proto(text, "scene", scene);
  return scene;
}

Observation observe(RenderPool& pool, const Material& truth, const v1::Scene& scene, uint64_t seed,
                    const std::string& name = "", double value = 0) {
  RenderJob job{.scene = serialize(scene), .request = {}};
  *job.request.mutable_material() = to_proto(truth);
  job.request.set_spp(256);
  job.request.set_seed(seed);
  job.request.set_pixels(v1::OBJECT_PIXELS);
  if (!name.empty()) set_value(job.request, name, value);
  const auto scene_bytes = job.scene;
  const v1::RenderGradReply reply = pool.render_split(job);
  return {.name = "render",
          .radiance = from_bytes<float>(reply.estimates(0).radiance()),
          .mask = from_bytes<float>(reply.mask()),
          .noise = from_bytes<float>(reply.standard_error()),
          .scene = scene_bytes};
}

// Some run in ten strays up the similarity ridge, and says so by wide intervals.
TEST(RenderedRefinement, RecoversMaterials) {
  constexpr int kSeeds = 3;
  RenderPool pool{RenderPoolOptions()};
  const Renderer renderer = rendered_by(pool);
  int narrow = 0;
  for (const Material& truth : {Material{30, 0.6, 0.1}, Material{20, 0.8, 0.4}}) {
    const std::vector<Observation> observations{observe(pool, truth, scene_of_text(kScene), 77)};
    for (int seed = 0; seed < kSeeds; ++seed) {
      v1::RefineSettings settings;
      settings.set_max_spp(1024);
      settings.set_seed(static_cast<uint64_t>(seed));
      Refinement refinement(settings, observations, {{91, 0.67, 0.4}});
      while (!refinement.finished()) refinement.step(renderer);
      const v1::RefineResult r = refinement.result();
      const auto expect = [&](const char* name, const v1::RefinedParameter& p, double value) {
        // Wide intervals are lopsided: what is told of this side counts.
        constexpr double kPer95 = 1.96;
        const double told = value < p.value() ? p.value() - p.low_95() : p.high_95() - p.value();
        expect_equal({p.value(), told / kPer95}, {value}, 6 * kSeeds, name);
      };
      expect("sigma_t", r.sigma_t(), truth.sigma_t);
      expect("albedo", r.albedo(), truth.albedo);
      expect("g", r.g(), truth.g);
      EXPECT_LE(r.iterations(), 20U);
      // An error of half as much again would have shown.
      if (r.sigma_t().standard_deviation() < 0.1 * truth.sigma_t &&
          r.albedo().standard_deviation() < 0.04 && r.g().standard_deviation() < 0.1) {
        ++narrow;
      }
    }
  }
  EXPECT_GE(narrow, 2 * kSeeds - 3);
}

// From other numbers than those that the image is of.
TEST(RenderedRefinement, RecoversNumbersOfTheScene) {
  constexpr int kSeeds = 1;
  constexpr Material kTruth{30, 0.5, 0.4};
  struct Case {
    const char* name;
    double truth, deviation;  // at most
    const char* boundary;
  };
  RenderPool pool{RenderPoolOptions()};
  const Renderer renderer = rendered_by(pool);
  for (const Case& c :
       {Case{"rough_dielectric.roughness", 0.25, 0.08, "rough_dielectric { roughness: 0.35 }"},
        Case{"rough_dielectric.index", 1.35, 0.12, "rough_dielectric { }"},
        Case{"surface[0].reflectance", 0.3, 0.015, ""},
        Case{"light[1].sphere.center.x", 4, 0.6, ""}}) {
    const v1::Scene scene = scene_of_text((std::string("object { ") + c.boundary + R"(
mesh { builtin: "figure" normalize: true } }
surfaces { rectangle { half_u { x: 20 } half_v { z: -20 } } reflectance: 0.6 }
lights { constant { radiance: 1 } }
lights { sphere { center { x: 6 y: 8 z: -6 } radius: 3 radiance: 20 } }
camera { origin { y: 9.28 z: -32.8 } target { y: 0.5 } fov_degrees: 2.5 }
film { width: 40 height: 40 }
)")
                                              .c_str());
    for (uint64_t seed = 0; seed < kSeeds; ++seed) {
      const std::vector<Observation> observations{
          observe(pool, kTruth, scene, 77 + seed, c.name, c.truth)};
      v1::RefineSettings settings;
      settings.set_max_spp(2048);
      settings.set_seed(seed);
      settings.add_unknowns(c.name);
      Refinement refinement(settings, observations, {{40, 0.55, 0.3}});
      while (!refinement.finished()) refinement.step(renderer);
      const v1::RefinedParameter p = refinement.result().unknowns(0);
      expect_equal({p.value(), p.standard_deviation()}, {c.truth}, 4 * kSeeds, c.name);
      EXPECT_LT(p.standard_deviation(), c.deviation) << c.name;
    }
  }
}

}  // namespace
}  // namespace itn
