// Straight lines through the boundary: lengths inside, order, and the places where rounding bites.
#include "server/tracer/geometry/line_geometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <ctime>
#include <functional>

#include "server/tracer/geometry/facets.h"
#include "server/tracer/geometry/lines/follow.h"
#include "server/tracer/random/sampler.h"
#include "tests/server/tracer/lane_probes.h"
#include "tests/server/tracer/scenes.h"
#include "tests/support/hard_meshes.h"

namespace itn::testing {
namespace {

using namespace tracer;
using End = RayResult::End;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

Mesh merged(const std::vector<Mesh>& parts) {
  Mesh all;
  for (const Mesh& part : parts) {
    const auto offset = static_cast<uint32_t>(all.vertices.size());
    all.vertices.insert(all.vertices.end(), part.vertices.begin(), part.vertices.end());
    for (const auto& [a, b, c] : part.triangles) {
      all.triangles.push_back({a + offset, b + offset, c + offset});
    }
  }
  return all;
}

// Either way to follow a line, one at a time.
class Lines {
 public:
  Lines(Tracer tracer, const Mesh& object, const std::vector<DiffuseSurface>& surfaces) {
    if (tracer == Tracer::kReference) {
      geometry_ = std::make_unique<Geometry>(object, surfaces);
    } else {
      obstacles_ = std::make_unique<Obstacles>(std::make_shared<const Object>(object), surfaces);
      rays_ = std::make_unique<Rays>();
    }
  }

  RayResult follow(const Interaction& from, Vec3f direction, float max_medium_length,
                   bool stops_at_boundary = false, float distance = kInfinity) const {
    if (geometry_) {
      return geometry_->follow(from, direction, max_medium_length, stops_at_boundary, distance);
    }
    rays_->bounded = distance < kInfinity;
    rays_->distance[0] = distance;
    rays_->position.set(0, from.position);
    rays_->direction.set(0, direction);
    rays_->max_medium_length[0] = max_medium_length;
    rays_->interaction[0] = from.inside ? Rays::kInside : 0;
    const auto& first = obstacles_->surfaces.first_triangle_of_mesh;
    if (from.on.surface != SurfaceTriangle::kNone) {
      rays_->interaction[0] |= Rays::on_surface(first[from.on.surface] + from.on.triangle);
    }
    Crossings crossings;
    if (stops_at_boundary) {
      follow_to_boundary(*obstacles_, *rays_, crossings, 1);
    } else {
      tracer::follow(*obstacles_, *rays_, 1);
    }
    RayResult ray;
    ray.end = static_cast<End>(rays_->outcome[0] & Rays::kEndMask);
    ray.medium_length = rays_->medium_length[0];
    ray.entered = (rays_->outcome[0] & Rays::kEntered) != 0;
    ray.at.position = rays_->position.at(0);
    ray.at.inside = (rays_->interaction[0] & Rays::kInside) != 0;
    if (ray.end == End::kSurface) {
      const uint32_t triangle = Rays::surface_of(rays_->interaction[0]);
      const auto mesh = std::upper_bound(first.begin(), first.end(), triangle) - 1;
      ray.at.on = {static_cast<uint32_t>(mesh - first.begin()), triangle - *mesh};
    } else if (ray.end == End::kCrossing) {
      ray.triangle = crossings.triangle[0];
      ray.normal = crossings.normal.at(0);
    }
    return ray;
  }

 private:
  std::unique_ptr<Geometry> geometry_;
  std::unique_ptr<Obstacles> obstacles_;
  std::unique_ptr<Rays> rays_;
};

class GeometryTest : public ::testing::TestWithParam<Tracer> {};

INSTANTIATE_TEST_SUITE_P(Tracers, GeometryTest,
                         ::testing::Values(Tracer::kReference, Tracer::kWavefront),
                         [](const auto& row) {
                           return row.param == Tracer::kReference ? "Reference" : "Wavefront";
                         });

TEST_P(GeometryTest, LengthInsideABox) {
  const Lines geometry(GetParam(), box({-1, 0, -1}, {1, 2, 1}), {});
  const RayResult across = geometry.follow({{-5, 1, 0.1F}, false, {}}, {1, 0, 0}, kInfinity);
  EXPECT_EQ(across.end, End::kEscaped);
  EXPECT_TRUE(across.entered);
  EXPECT_NEAR(across.medium_length, 2, 1e-5);
  const RayResult from_within = geometry.follow({{0, 1, 0.1F}, true, {}}, {0, 1, 0}, kInfinity);
  EXPECT_EQ(from_within.end, End::kEscaped);
  EXPECT_NEAR(from_within.medium_length, 1, 1e-5);
  const RayResult beside = geometry.follow({{-5, 3, 0}, false, {}}, {1, 0, 0}, kInfinity);
  EXPECT_EQ(beside.end, End::kEscaped);
  EXPECT_FALSE(beside.entered);
}

TEST_P(GeometryTest, BudgetIsSpentInTheMediumOnly) {
  const Lines geometry(GetParam(), merged({box({0, 0, 0}, {1, 1, 1}), box({3, 0, 0}, {4, 1, 1})}),
                       {});
  const RayResult ray = geometry.follow({{-1, 0.4F, 0.5F}, false, {}}, {1, 0, 0}, 1.5F);
  EXPECT_EQ(ray.end, End::kInMedium);
  EXPECT_NEAR(ray.at.position.x, 3.5, 1e-5);
  EXPECT_TRUE(ray.at.inside);
}

TEST_P(GeometryTest, EndsAtItsDistance) {
  const Lines geometry(GetParam(),
                       merged({box({-1, 0, -1}, {1, 2, 1}), box({2, 0, -1}, {4, 2, 1})}),
                       {{horizontal_square(-1, 20), 0.5F}});
  const auto follow = [&](Vec3f from, bool inside, Vec3f direction, float distance,
                          float max_medium_length = kInfinity) {
    return geometry.follow({from, inside, {}}, direction, max_medium_length, false, distance);
  };
  const Vec3f left{-5, 1, 0.1F}, middle{0, 1, 0.1F};
  struct Row {
    float distance, medium_length;
  };
  for (const Row row : {Row{3, 0}, Row{4.5F, 0.5F}, Row{6.5F, 2}, Row{8, 3}, Row{1000, 4}}) {
    const RayResult ray = follow(left, false, {1, 0, 0}, row.distance);
    EXPECT_EQ(ray.end, End::kEscaped) << row.distance;
    EXPECT_NEAR(ray.medium_length, row.medium_length, 1e-5);
    EXPECT_EQ(ray.entered, row.medium_length > 0);
  }
  // In the cell that it begins in, and beyond; with a length in the medium that ends before, or
  // not.
  for (const float distance : {1e-3F, 0.25F, 0.75F}) {
    const RayResult ray = follow(middle, true, {1, 0, 0}, distance);
    EXPECT_EQ(ray.end, End::kEscaped) << distance;
    EXPECT_NEAR(ray.medium_length, distance, 1e-5);
    EXPECT_EQ(follow(middle, true, {1, 0, 0}, distance, 2 * distance).end, End::kEscaped);
    EXPECT_EQ(follow(middle, true, {1, 0, 0}, distance, distance / 2).end, End::kInMedium);
  }
  // Before a surface, and behind it.
  EXPECT_EQ(follow(middle, true, {0, -1, 0}, 1.9F).end, End::kEscaped);
  EXPECT_EQ(follow(middle, true, {0, -1, 0}, 2.1F).end, End::kSurface);
}

// Two boxes that share a face: the exit of one and the entry of the other coincide.
TEST_P(GeometryTest, TouchingParts) {
  const Lines geometry(GetParam(), merged({box({0, 0, 0}, {1, 1, 1}), box({1, 0, 0}, {2, 1, 1})}),
                       {});
  for (const float y : {0.1F, 0.3F, 0.77F}) {
    const RayResult ray = geometry.follow({{-1, y, 0.4F}, false, {}}, {1, 0, 0}, kInfinity);
    EXPECT_NEAR(ray.medium_length, 2, 1e-5);
  }
}

// A box that stands on the floor: its bottom and the floor are in one plane.
TEST_P(GeometryTest, StandingOnTheFloor) {
  const Lines geometry(GetParam(), box({-1, 0, -1}, {1, 2, 1}), {{horizontal_square(0, 20), 0.5F}});
  const Vec3f down = itn::normalize(Vec3f{0.1F, -1, 0.2F});
  const RayResult to_floor = geometry.follow({{0, 1, 0}, true, {}}, down, kInfinity);
  ASSERT_EQ(to_floor.end, End::kSurface);
  EXPECT_NEAR(to_floor.at.position.y, 0, 1e-7);
  EXPECT_NEAR(to_floor.medium_length, 1 / -down.y, 1e-5);
  // The line goes up again, whichever of the two coincident planes was met first.
  const RayResult up = geometry.follow(to_floor.at, {0, 1, 0}, kInfinity);
  EXPECT_EQ(up.end, End::kEscaped);
  EXPECT_NEAR(up.medium_length, 2, 1e-5);
}

TEST_P(GeometryTest, CavityIsOutside) {
  Mesh cavity = box({0.25F, 0.25F, 0.25F}, {0.75F, 0.75F, 0.75F});
  for (auto& triangle : cavity.triangles) std::swap(triangle[1], triangle[2]);
  const Lines geometry(GetParam(), merged({box({0, 0, 0}, {1, 1, 1}), cavity}), {});
  const RayResult ray = geometry.follow({{-1, 0.51F, 0.49F}, false, {}}, {1, 0, 0}, kInfinity);
  EXPECT_NEAR(ray.medium_length, 0.5, 1e-5);
}

// Lines in random directions from points inside come out, once, on every shape; lines from far away
// end outside. What is misjudged is about one in a million.
TEST_P(GeometryTest, LeaksAreRare) {
  uint64_t lines = 0, leaks = 0;
  for (const ShapeInfo& shape : builtin_shapes()) {
    const Lines geometry(GetParam(), make_shape(shape.name), {{horizontal_square(0, 20), 0.5F}});
    Interaction from;
    for (uint32_t i = 0; i < 40'000; ++i) {
      const Uniforms u = Sampler(5, 0, 0).uniforms(i, 0);
      const float y = 1 - 2 * u[0], r = std::sqrt(std::max(0.0F, 1 - y * y));
      const float phi = 6.2831853F * u[1];
      const Vec3f direction = itn::normalize(Vec3f{r * std::cos(phi), y, r * std::sin(phi)});
      if (!from.inside) {  // start again from outside, aimed at the middle of the shape
        from = {Vec3f{0, 0.5F, 0} - direction * 3, false, {}};
        if (from.position.y < 0) continue;
      }
      const RayResult ray = geometry.follow(from, direction, -std::log(1 - u[2]) / 100);
      ++lines;
      leaks += ray.end == End::kLeaked ? 1 : 0;
      from = ray.end == End::kInMedium ? ray.at : Interaction{};
    }
  }
  EXPECT_GT(lines, 500'000U);
  EXPECT_LE(leaks, 3U) << "of " << lines << " lines";
}

// The two tracers share no code here: the same lines must give the same lengths and ends.
// That a crossing lies on its triangle, within the three edges, and that the rest fits.
void expect_on(const Mesh& mesh, const RayResult& at, Vec3f direction) {
  ASSERT_LT(at.triangle, mesh.triangles.size());
  const auto corner = [&](size_t k) {
    return static_cast<Vec3d>(mesh.vertices[mesh.triangles[at.triangle][k]]);
  };
  const Vec3d a = corner(0), b = corner(1), c = corner(2);
  const Vec3d normal = itn::normalize(cross(b - a, c - a));
  EXPECT_GT(dot(normal, static_cast<Vec3d>(at.normal)), 1 - 1e-4);
  EXPECT_EQ(dot(direction, at.normal) > 0, at.at.inside);
  const auto point = static_cast<Vec3d>(at.at.position);
  EXPECT_NEAR(dot(point - a, normal), 0, 1e-4);
  for (const auto& [from, to] : {std::pair{a, b}, {b, c}, {c, a}}) {
    EXPECT_GT(dot(cross(itn::normalize(to - from), point - from), normal), -1e-4);
  }
}

TEST_P(GeometryTest, StopsAtTheBoundaryWhereItIs) {
  const Mesh knot = make_shape("knot");
  const Lines lines(GetParam(), knot, {});
  int crossed = 0;
  for (uint32_t i = 0; i < 300; ++i) {
    const Uniforms u = Sampler(12, 0, 0).uniforms(i, 0), v = Sampler(12, 0, 0).uniforms(i, 1);
    const Vec3f target{u[0] - 0.5F, u[1] * 0.8F, u[2] - 0.5F};
    const Vec3f direction = itn::normalize(Vec3f{v[0] - 0.5F, v[1] - 0.5F, v[2] - 0.5F});
    Interaction at{target - direction * 3.0F, false, {}};
    // To the first crossing, from there to the next, and so on.
    for (;;) {
      const RayResult ray = lines.follow(at, direction, kInfinity, true);
      if (ray.end != End::kCrossing) {
        EXPECT_EQ(ray.end, End::kEscaped);
        break;
      }
      ++crossed;
      EXPECT_TRUE(ray.entered);
      EXPECT_EQ(ray.at.inside, at.inside);
      EXPECT_EQ(ray.medium_length > 0, at.inside);
      expect_on(knot, ray, direction);
      at = {ray.at.position, !at.inside, {}};
    }
  }
  EXPECT_GT(crossed, 200);
}

TEST(TracersTest, AgreeLineByLine) {
  for (const char* shape : {"cube", "smooth_star", "gear", "mug", "leaf"}) {
    const std::vector<DiffuseSurface> floor = {{horizontal_square(0, 20), 0.5F}};
    const Lines embree(Tracer::kReference, make_shape(shape), floor);
    const Lines grid(Tracer::kWavefront, make_shape(shape), floor);
    int different = 0, lines = 0;
    for (uint32_t i = 0; i < 40'000; ++i) {
      const Uniforms u = Sampler(6, 0, 0).uniforms(i, 0), v = Sampler(6, 0, 0).uniforms(i, 1);
      const float y = 1 - 2 * u[0], r = std::sqrt(std::max(0.0F, 1 - y * y));
      const float phi = 6.2831853F * u[1];
      const Vec3f direction{r * std::cos(phi), y, r * std::sin(phi)};
      const Vec3f target{v[0] - 0.5F, v[1], v[2] - 0.5F};
      const Interaction from{target - itn::normalize(direction) * 3, false, {}};
      if (from.position.y < 0.01F) continue;
      const float distance = i % 2 == 0 ? kInfinity : 6 * u[2];
      const RayResult a =
          embree.follow(from, itn::normalize(direction), kInfinity, false, distance);
      const RayResult b = grid.follow(from, itn::normalize(direction), kInfinity, false, distance);
      ++lines;
      different += a.end != b.end || std::abs(a.medium_length - b.medium_length) > 1e-4F ? 1 : 0;
    }
    EXPECT_GT(lines, 10'000);
    EXPECT_LE(different, 2) << shape << ", of " << lines << " lines";  // grazing an edge
  }
}

// Whether a surface is in front is found among many triangles as among few: of a square in two
// triangles, and in many.
TEST(SurfacesTest, AreInFrontInHoweverManyTriangles) {
  const auto square_of = [](int n) {
    Mesh mesh;
    for (int j = 0; j <= n; ++j) {
      for (int i = 0; i <= n; ++i) {
        mesh.vertices.push_back({2.0F * static_cast<float>(i) / static_cast<float>(n) - 1, 0,
                                 2.0F * static_cast<float>(j) / static_cast<float>(n) - 1});
      }
    }
    for (int j = 0; j < n; ++j) {
      for (int i = 0; i < n; ++i) {
        const auto at = static_cast<uint32_t>(j * (n + 1) + i), above = at + n + 1;
        mesh.triangles.push_back({at, above, at + 1});
        mesh.triangles.push_back({at + 1, above, above + 1});
      }
    }
    return std::vector<DiffuseSurface>{{mesh, 0.5F}};
  };
  const Surfaces few(square_of(1)), many(square_of(40));
  ASSERT_FALSE(few.many);
  ASSERT_TRUE(many.many);
  int in_front = 0, different = 0;
  constexpr uint32_t kLines = 20'000;
  for (uint32_t i = 0; i < kLines; ++i) {
    const Uniforms u = Sampler(9, 0, 0).uniforms(i, 0), v = Sampler(9, 0, 0).uniforms(i, 1);
    const Vec3d from{3.0 * u[0] - 1.5, 1.0 + u[1], 3.0 * u[2] - 1.5};
    const Vec3d to{3.0 * v[0] - 1.5, 2.0 * v[1] - 1, 3.0 * v[2] - 1.5};
    const Vec3d direction = (to - from) * 0.5;  // not of unit length
    const bool expected = few.in_front(from, direction, 2);
    in_front += expected ? 1 : 0;
    different += many.in_front(from, direction, 2) != expected ? 1 : 0;
  }
  EXPECT_GT(in_front, 2000);
  EXPECT_LT(in_front, 18'000);
  EXPECT_LE(different, 10) << "of " << kLines;  // that end at the square, or graze its edge
}

// Among so many triangles that looking at one after the other would take minutes.
TEST(SurfacesTest, AreFoundQuicklyAmongManyTriangles) {
  const Mesh ground = make_shape("frame");
  ASSERT_GT(ground.triangles.size(), 40'000U);
  const Surfaces surfaces({{ground, 0.5F}});
  const std::clock_t start = std::clock();  // of the processor, not of a busy machine
  int found = 0;
  for (uint32_t i = 0; i < 100'000; ++i) {
    const Uniforms u = Sampler(10, 0, 0).uniforms(i, 0);
    const Vec3d through{u[0] - 0.5, u[1], u[2] - 0.5};
    found += surfaces.in_front({0, 0.5, -3}, through - Vec3d{0, 0.5, -3}, 2) ? 1 : 0;
  }
  EXPECT_GT(found, 1000);
  EXPECT_LT(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC, 5);
}

// Lines through meshes of slivers and extremes: what both tracers find is the same, though the
// cells of one are coarser than usual there.
TEST(TracersTest, AgreeLineByLineOnHardMeshes) {
  struct Row {
    const char* name;
    Mesh mesh;
  };
  const Row rows[] = {{"fan", cone_fan(8000)},
                      {"needles", needles(300, 1e-3)},
                      {"sheets", stacked_sheets(300)},
                      {"repeated", repeated(make_shape("cube"), 200)},
                      {"large and tiny", large_and_tiny()}};
  for (const Row& row : rows) {
    const Lines embree(Tracer::kReference, row.mesh, {}), grid(Tracer::kWavefront, row.mesh, {});
    const Bounds box = bounds(row.mesh);
    int different = 0, entered = 0;
    constexpr uint32_t kLines = 5000;
    for (uint32_t i = 0; i < kLines; ++i) {
      const Uniforms u = Sampler(11, 0, 0).uniforms(i, 0), v = Sampler(11, 0, 0).uniforms(i, 1);
      const float y = 1 - 2 * u[0], r = std::sqrt(std::max(0.0F, 1 - y * y));
      const float phi = 6.2831853F * u[1];
      const Vec3f direction = itn::normalize(Vec3f{r * std::cos(phi), y, r * std::sin(phi)});
      const Vec3f extent = box.max - box.min;
      const Vec3f target = box.min + Vec3f{extent.x * v[0], extent.y * v[1], extent.z * v[2]};
      const Interaction from{target - direction * 5, false, {}};
      const RayResult a = embree.follow(from, direction, kInfinity);
      const RayResult b = grid.follow(from, direction, kInfinity);
      entered += a.entered ? 1 : 0;
      different += a.end != b.end || std::abs(a.medium_length - b.medium_length) > 1e-4F ? 1 : 0;
    }
    EXPECT_GT(entered, 20) << row.name;
    EXPECT_LE(different, 5) << row.name << ", of " << kLines << " lines";  // grazing an edge
  }
}

// The depth of a point below the sides of a box, to what a cell is long and steps between cells are
// not straight.
TEST(DepthsTest, TellTheDistanceToTheBoundary) {
  const Mesh box = make_shape("cube");
  const DepthGrid depth_grid(box);
  const Bounds sides = bounds(box);
  const double edge = depth_grid.cells.edge;
  const auto [nx, ny, nz] = depth_grid.cells.size;
  double deepest = 0;
  for (int z = 0; z < nz; ++z) {
    for (int y = 0; y < ny; ++y) {
      for (int x = 0; x < nx; ++x) {
        const Vec3d p = depth_grid.cells.low + Vec3d{x + 0.5, y + 0.5, z + 0.5} * edge;
        const double depth = std::min({p.x - sides.min.x, sides.max.x - p.x, p.y - sides.min.y,
                                       sides.max.y - p.y, p.z - sides.min.z, sides.max.z - p.z});
        const double told = depth_grid.quantized[depth_grid.cells.index(x, y, z)] * edge / 3;
        EXPECT_NEAR(told, depth, 1.01 * edge) << x << " " << y << " " << z;
        deepest = std::max(deepest, told);
      }
    }
  }
  EXPECT_NEAR(deepest, 0.5, 2 * edge);
}

// Many points at a time, of a body of three different sides, and beside it.
TEST(DepthsTest, AreLookedUpWhereThePointsAre) {
  const Mesh leaf = make_shape("leaf");
  const DepthGrid depth_grid(leaf);
  const CellNormals normals(leaf, depth_grid);
  const auto [nx, ny, nz] = depth_grid.cells.size;
  EXPECT_TRUE(nx != ny && ny != nz && nz != nx);
  const auto probe = std::make_unique<CellProbe>();
  for (uint32_t batch = 0; batch < 200; ++batch) {
    std::vector<float> expected;
    for (uint32_t i = 0; i < kSlots; ++i) {
      const Uniforms u = Sampler(8, 0, batch).uniforms(i, 0);
      // In cells; a tenth of the range outside at either end. The first is in the last cell.
      const auto place = [&](float v, int size) {
        return i == 0 ? size - 0.5 : (1.2 * double{v} - 0.1) * size;
      };
      const double x = place(u[0], nx), y = place(u[1], ny), z = place(u[2], nz);
      probe->points.set(
          i, static_cast<Vec3f>(depth_grid.cells.low + Vec3d{x, y, z} * depth_grid.cells.edge));
      const auto cell = [](double c, int size) {
        return std::clamp(static_cast<int>(std::floor(c)), 0, size - 1);
      };
      expected.push_back(
          depth_grid.quantized[depth_grid.cells.index(cell(x, nx), cell(y, ny), cell(z, nz))]);
    }
    look_up_cells(depth_grid, normals, *probe);
    int different = 0;  // rounding decides at the faces of cells
    for (uint32_t i = 0; i < kSlots; ++i) different += probe->quantized[i] != expected[i] ? 1 : 0;
    EXPECT_LE(different, 2) << "batch " << batch;
    EXPECT_EQ(probe->quantized[0], expected[0]);
  }
}

// Each triangle has itself around it, then the three that it shares an edge with, and then those
// that it shares a vertex with; and knows which points are in it.
TEST(FacetsTest, KnowWhatIsAroundThem) {
  const Mesh mesh = make_shape("cube");
  const Facets facets(mesh);
  ASSERT_EQ(facets.by_triangle.size(), mesh.triangles.size());
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::vector<uint32_t> around(facets.around.begin() + facets.first[t],
                                       facets.around.begin() + facets.first[t + 1]);
    std::vector<size_t> shared;
    for (const uint32_t other : around) {
      shared.push_back(
          static_cast<size_t>(std::ranges::count_if(mesh.triangles[other], [&](uint32_t vertex) {
            return std::ranges::count(mesh.triangles[t], vertex) > 0;
          })));
    }
    EXPECT_EQ(around[0], t);
    EXPECT_EQ(std::ranges::count(shared, 3), 1);
    EXPECT_EQ(std::ranges::count(shared, 2), 3);
    EXPECT_GE(std::ranges::count(shared, 1), 3);
    EXPECT_TRUE(std::ranges::is_sorted(shared, std::greater())) << t;
    EXPECT_EQ(std::ranges::count(shared, 0), 0);
    const auto& [corner, normal, v, w] = facets.by_triangle[t];
    const auto& [a, b, c] = mesh.triangles[t];
    const Vec3f to_b = mesh.vertices[b] - corner, to_c = mesh.vertices[c] - corner;
    EXPECT_NEAR(length(mesh.vertices[a] - corner), 0, 1e-6F);
    EXPECT_NEAR(dot(normal, to_b), 0, 1e-6F);
    for (const auto& [of_b, of_c] : {std::pair{0.2F, 0.3F}, {1.0F, 0.0F}, {0.0F, 1.0F}}) {
      const Vec3f p = to_b * of_b + to_c * of_c;
      EXPECT_NEAR(dot(p, v), of_b, 1e-5F);
      EXPECT_NEAR(dot(p, w), of_c, 1e-5F);
    }
  }
}

// The normals of a cube are its sides' but near the edges; of a ball, those of a place that is not
// much farther away than the nearest, as depths are not.
TEST(CellNormalsTest, FaceAsTheBoundaryNearby) {
  for (const char* shape : {"cube", "sphere"}) {
    const Mesh mesh = make_shape(shape);
    const bool round = shape == std::string("sphere");
    const DepthGrid depth_grid(mesh);
    const CellNormals normals(mesh, depth_grid);
    EXPECT_LE(normals.memory(), CellNormals::most_memory());
    const Bounds sides = bounds(mesh);
    const Vec3f middle = (sides.min + sides.max) * 0.5F, half = (sides.max - sides.min) * 0.5F;
    const auto edge = static_cast<float>(depth_grid.cells.edge);
    const auto probe = std::make_unique<CellProbe>();
    for (uint32_t i = 0; i < kSlots; ++i) {
      const Uniforms u = Sampler(9, 0, 0).uniforms(i, 0);
      const auto place = [](float v, float reach) { return (2 * v - 1) * reach; };
      probe->points.set(
          i, middle + Vec3f{place(u[0], half.x), place(u[1], half.y), place(u[2], half.z)});
    }
    look_up_cells(depth_grid, normals, *probe);
    int looked_at = 0;
    for (uint32_t i = 0; i < kSlots; ++i) {
      const Vec3f p = probe->points.at(i) - middle, normal = probe->normals.at(i);
      EXPECT_NEAR(length(normal), 1, 1e-5F);
      if (round) {
        const float radius = half.x, depth = radius - length(p);
        if (depth < 0) continue;
        EXPECT_LT(length(normal * radius - p), 1.1F * depth + 2 * edge) << "point " << i;
      } else {
        const std::array<float, 3> depths{half.x - std::abs(p.x), half.y - std::abs(p.y),
                                          half.z - std::abs(p.z)};
        const auto least = std::ranges::min_element(depths);
        const auto axis = least - depths.begin();
        if (std::ranges::count_if(depths, [&](float d) { return d < *least + 3 * edge; }) > 1) {
          continue;
        }
        const float out = std::array<float, 3>{p.x, p.y, p.z}[axis] > 0 ? 1.0F : -1.0F;
        EXPECT_NEAR((std::array<float, 3>{normal.x, normal.y, normal.z}[axis]), out, 1e-5F)
            << "point " << i;
      }
      ++looked_at;
    }
    EXPECT_GT(looked_at, 150) << shape;
  }
}

}  // namespace
}  // namespace itn::testing
