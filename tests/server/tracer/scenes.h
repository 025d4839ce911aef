// Scenes that the tests of the tracer share.
#pragma once

#include <string>
#include <vector>

#include "common/geometry/shapes.h"
#include "server/tracer/render.h"
#include "server/tracer/scene/scene.h"
#include "tests/support/statistics.h"

namespace itn::testing {

// An axis-aligned box of 12 triangles.
Mesh box(Vec3f low, Vec3f high);

// A horizontal square, facing up.
Mesh horizontal_square(float y, float half_size);

// A unit sphere of 2,048 triangles: an octahedron whose triangles are cut in four, four times.
Mesh sphere_of_triangles();

// A shape in the middle of a small film, lit by `lights`; a view from 15 degrees above the horizon
// that the shape fills. With a ground if `ground` is >= 0, its reflectance.
tracer::SceneDescription studio(const std::string& shape,
                                std::vector<tracer::LightDescription> lights, float ground = -1,
                                int resolution = 8);

// The sun and sky of the paper's set-up: turbidity 3, elevation 60 degrees, a sun of 18.75 degrees.
tracer::SunSkyLight paper_sun_sky(double azimuth = 0.5);

// The places of the medium's parameters in tracer::medium_parameters().
enum Coordinate { kSigmaT, kAlbedo, kG, kCoordinates };

// Mean over the film of one layer: -1 radiance, else the number of a derivative; of estimate `k`.
double film_mean(const tracer::FilmSums& sums, int layer, size_t k = 0);

// Mean over the film and its standard error, over renders with `batches` different seeds.
struct FilmEstimate {
  Estimated radiance;
  std::vector<Estimated> derivatives;  // those of the request
  tracer::Counters counters;
};
FilmEstimate estimate_film(const tracer::Scene& scene, tracer::RenderRequest request, int batches,
                           uint64_t first_seed = 1, const tracer::RenderOptions& options = {});

// Expects that two estimates of an image agree with all of its derivatives, and that an error of 2
// % in any of them would have shown. What the derivatives are measured by is their own size, unless
// `scales` says otherwise.
void expect_same_film(const FilmEstimate& a, const FilmEstimate& b, int comparisons,
                      const std::string& what, const std::vector<double>& scales = {});

}  // namespace itn::testing
