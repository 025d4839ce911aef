// Real renders: the truth is found within what is stated.
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "client/refine/refinement.h"
#include "client/render_pool/render_pool.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"
#include "common/scene/text_proto.h"
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

Observation observe(RenderPool& pool, const Material& truth) {
  v1::Scene scene;
  parse_text_proto(kScene, "scene", scene);
  RenderJob job{.scene = serialize(scene), .request = {}};
  *job.request.mutable_material() = to_proto(truth);
  job.request.set_spp(256);
  job.request.set_seed(77);
  job.request.set_pixels(v1::OBJECT_PIXELS);
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
  constexpr int kSeeds = 4;
  RenderPool pool{RenderPoolOptions()};
  const Synthesize synthesize = rendered_by(pool);
  int narrow = 0;
  for (const Material& truth : {Material{30, 0.6, 0.1}, Material{20, 0.8, 0.4}}) {
    const std::vector<Observation> observations{observe(pool, truth)};
    for (int seed = 0; seed < kSeeds; ++seed) {
      v1::RefineSettings settings;
      settings.set_max_spp(1024);
      settings.set_seed(static_cast<uint64_t>(seed));
      Refinement refinement(settings, observations, {{91, 0.67, 0.4}});
      while (!refinement.finished()) refinement.step(synthesize);
      const v1::RefineResult r = refinement.result();
      const auto expect = [&](const char* name, const v1::RefinedParameter& p, double value) {
        expect_equal({p.value(), p.standard_deviation()}, {value}, 6 * kSeeds, name);
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

}  // namespace
}  // namespace itn
