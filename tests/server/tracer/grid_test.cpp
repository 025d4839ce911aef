// Which cells triangles are looked for in, what that costs at most, and that it can be stopped.
#include "server/tracer/geometry/grid.h"

#include <gtest/gtest.h>
#include <pthread.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "common/error.h"
#include "server/tracer/geometry/cell_normals.h"
#include "server/tracer/geometry/corner_normals.h"
#include "server/tracer/geometry/cubic_cells.h"
#include "server/tracer/geometry/depth_grid.h"
#include "server/tracer/random/sampler.h"
#include "server/tracer/scene/scene.h"
#include "tests/support/hard_meshes.h"

namespace itn::testing {
namespace {

using namespace tracer;

// ---- Which cells a triangle touches ----------------------------------------------------------

// The part of a convex polygon with sign * x[axis] <= sign * limit.
std::vector<Vec3d> clipped(const std::vector<Vec3d>& polygon, int axis, double limit, double sign) {
  const auto beyond = [&](Vec3d p) {
    const double x[] = {p.x, p.y, p.z};
    return sign * (x[axis] - limit);
  };
  std::vector<Vec3d> result;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const Vec3d p = polygon[i], q = polygon[(i + 1) % polygon.size()];
    const double a = beyond(p), b = beyond(q);
    if (a <= 0) result.push_back(p);
    if ((a < 0 && b > 0) || (a > 0 && b < 0)) result.push_back(p + (q - p) * (a / (a - b)));
  }
  return result;
}

// By cutting the triangle to the cell.
bool meets(const CubicCells& cells, const std::vector<Vec3d>& triangle, std::array<int, 3> cell,
           double margin) {
  std::vector<Vec3d> rest = triangle;
  const double low[] = {cells.low.x, cells.low.y, cells.low.z};
  for (int axis = 0; axis < 3; ++axis) {
    rest = clipped(rest, axis, low[axis] + cell[axis] * cells.edge - margin, -1);
    rest = clipped(rest, axis, low[axis] + (cell[axis] + 1) * cells.edge + margin, 1);
  }
  return !rest.empty();
}

Mesh random_triangle(uint32_t number) {
  const Sampler random(31, number, 0);
  Mesh mesh{{}, {{0, 1, 2}}};
  const Uniforms u = random.uniforms(0, 0), v = random.uniforms(0, 1), w = random.uniforms(0, 2);
  mesh.vertices = {{u[0], u[1], u[2]}, {v[0], v[1], v[2]}, {w[0], w[1], w[2]}};
  if (number % 3 == 1) {  // a sliver
    mesh.vertices[2] = mesh.vertices[0] * 0.5F + mesh.vertices[1] * 0.5F + Vec3f{0, 1e-5F, 0};
  } else if (number % 3 == 2) {  // in a plane of an axis
    for (Vec3f& p : mesh.vertices) p.y = u[3];
  }
  return mesh;
}

TEST(TriangleAmongCellsTest, TouchesTheCellsThatItMeetsAndNoOthers) {
  const CubicCells cells{{0, 0, 0}, 1.0 / 16, {16, 16, 16}};
  const double margin = 1e-3 * cells.edge;
  size_t touched = 0;
  for (uint32_t number = 0; number < 60; ++number) {
    const Mesh mesh = random_triangle(number);
    std::vector<Vec3d> triangle;
    for (const Vec3f& p : mesh.vertices) triangle.push_back(static_cast<Vec3d>(p));
    std::multiset<size_t> found;
    TriangleAmongCells(cells, mesh, mesh.triangles[0], margin).for_each([&](size_t cell) {
      found.insert(cell);
    });
    for (int z = 0; z < 16; ++z) {
      for (int y = 0; y < 16; ++y) {
        for (int x = 0; x < 16; ++x) {
          const size_t count = found.count(cells.index(x, y, z));
          // Rounding decides at the margin.
          const bool surely = meets(cells, triangle, {x, y, z}, 0.999 * margin);
          const bool maybe = meets(cells, triangle, {x, y, z}, 1.001 * margin);
          ASSERT_LE(count, maybe ? 1U : 0U) << "triangle " << number;
          ASSERT_GE(count, surely ? 1U : 0U) << "triangle " << number;
        }
      }
    }
    touched += found.size();
  }
  EXPECT_GT(touched, 2000U);
}

TEST(ExpectedTouchesTest, AreTheMeanOverPlacesOfTheGrid) {
  Cancellation never;
  for (uint32_t number = 0; number < 6; ++number) {
    const Mesh mesh = random_triangle(number);
    const double edge = 0.11;
    double sum = 0;
    constexpr int kPlaces = 4000;
    for (uint32_t i = 0; i < kPlaces; ++i) {
      const Uniforms u = Sampler(32, number, 0).uniforms(i, 0);
      const CubicCells cells{
          Vec3d{u[0], u[1], u[2]} * edge - Vec3d{edge, edge, edge} * 2, edge, {16, 16, 16}};
      TriangleAmongCells(cells, mesh, mesh.triangles[0], 0).for_each([&](size_t) { ++sum; });
    }
    const ExpectedTouches expected(mesh, never);
    EXPECT_NEAR(sum / kPlaces / expected.for_edge(edge), 1, 0.02) << "triangle " << number;
    EXPECT_NEAR(expected.for_edge(expected.edge_for(37)), 37, 1e-6);
  }
}

// ---- What grids cost -------------------------------------------------------------------------

struct HardMesh {
  const char* name;
  std::function<Mesh()> make;
};

class HardMeshTest : public ::testing::TestWithParam<HardMesh> {};

INSTANTIATE_TEST_SUITE_P(
    Table, HardMeshTest,
    ::testing::Values(HardMesh{"Fan16k", [] { return cone_fan(8000); }},
                      HardMesh{"Fan100k", [] { return cone_fan(50'000); }},
                      HardMesh{"Repeated", [] { return repeated(make_shape("cube"), 2000); }},
                      HardMesh{"TwoNeedles", [] { return needles(2); }},
                      HardMesh{"Needles", [] { return needles(10'000); }},
                      HardMesh{"Diagonals", [] { return diagonal_slivers(60'000); }},
                      HardMesh{"LargeAndTiny", [] { return large_and_tiny(); }},
                      HardMesh{"Sheets", [] { return stacked_sheets(300); }},
                      HardMesh{"OneTriangle", [] { return random_triangle(0); }},
                      HardMesh{"NoArea",
                               [] {
                                 return Mesh{{{1, 1, 1}, {2, 3, 4}}, {{0, 1, 1}}};
                               }},
                      HardMesh{"Usual", [] { return make_shape("urchin"); }}),
    [](const auto& row) { return std::string(row.param.name); });

TEST_P(HardMeshTest, CostsWhatItsTrianglesAllow) {
  const Mesh mesh = GetParam().make();
  const Grid grid(mesh);
  const DepthGrid depth_grid(mesh);
  EXPECT_LE(grid.memory(), Grid::most_memory(mesh.triangles.size()));
  EXPECT_LE(depth_grid.memory(), DepthGrid::most_memory());
  EXPECT_LE(CellNormals(mesh, depth_grid).memory(), CellNormals::most_memory());
  EXPECT_GE(grid.occupied.size(), 1U);
  EXPECT_EQ(std::count_if(grid.cells.begin(), grid.cells.end(),
                          [](uint32_t word) { return (word & Grid::kOccupied) != 0; }),
            static_cast<long>(grid.occupied.size()));
}

// Points of every triangle lie in cells that hold it.
TEST_P(HardMeshTest, TrianglesAreFoundWhereTheyAre) {
  const Mesh mesh = GetParam().make();
  const Grid grid(mesh);
  const size_t step = std::max<size_t>(1, mesh.triangles.size() / 50);
  for (size_t t = 0; t < mesh.triangles.size(); t += step) {
    const auto corner = [&](size_t k) {
      return static_cast<Vec3d>(mesh.vertices[mesh.triangles[t][k]]);
    };
    for (uint32_t i = 0; i < 20; ++i) {
      const Uniforms u = Sampler(33, 0, 0).uniforms(i, 0);
      const double a = std::sqrt(u[0]), b = double{u[1]} * a;
      const Vec3d p = corner(0) * (1 - a) + corner(1) * (a - b) + corner(2) * b;
      const auto place = [&](double x, float low, int size) {
        return std::clamp(static_cast<int>((x - double{low}) / double{grid.edge}), 0, size - 1);
      };
      const size_t cell =
          (static_cast<size_t>(place(p.z, grid.low.z, grid.size[2])) * grid.size[1] +
           place(p.y, grid.low.y, grid.size[1])) *
              grid.size[0] +
          place(p.x, grid.low.x, grid.size[0]);
      ASSERT_TRUE(grid.cells[cell] & Grid::kOccupied) << "triangle " << t;
      const OccupiedCell& holder = grid.occupied[grid.cells[cell] & Grid::kPayload];
      const auto holds = [&](const TriangleBlock& block) {
        for (size_t k = 0; k < TriangleBlock::kSize; ++k) {
          bool same = true;
          for (size_t c = 0; c < 3; ++c) {
            const Vec3f expected = mesh.vertices[mesh.triangles[t][c]] - holder.middle;
            same = same && block.corners[c][0][k] == expected.x &&
                   block.corners[c][1][k] == expected.y && block.corners[c][2][k] == expected.z;
          }
          if (same) return true;
        }
        return false;
      };
      const auto first = grid.blocks.begin() + holder.first_block;
      ASSERT_TRUE(std::any_of(first, first + holder.block_count, holds)) << "triangle " << t;
    }
  }
}

TEST(EstimatedMemoryTest, CoversTheSceneAndGrowsWithItsParts) {
  SceneDescription scene;
  scene.object = make_shape("smooth_star");
  scene.lights = {ConstantLight{}};
  scene.camera = {.origin = {0, 0.5, -5}, .target = {0, 0.5, 0}};
  scene.film = {8, 8, Channel::kLuminance};
  const size_t delta_bounce = estimated_memory(scene);
  scene.surfaces.push_back({make_shape("frame"), 0.5F});
  EnvironmentMapLight map{.width = 256, .height = 128, .rgb = {}};
  map.rgb.assign(size_t{3} * 256 * 128, 1.0F);
  scene.lights.push_back(map);
  const size_t all = estimated_memory(scene);
  EXPECT_GT(all, delta_bounce + 256 * 128 * 12);
  EXPECT_LE(Scene(scene).memory(), all);
  EXPECT_LT(all, 100U << 20);
}

// Normals are interpolated whether the object was compiled before or not, and only if asked for.
TEST(EstimatedMemoryTest, CountsInterpolatedNormals) {
  SceneDescription scene;
  scene.object = make_shape("smooth_star");
  const size_t normals = scene.object.triangles.size() * 3 * sizeof(Vec3f);
  for (const bool compiled : {false, true}) {
    if (compiled) scene.compiled_object = compile_object(make_shape("smooth_star"), "object");
    scene.smooth_angle = 0;
    const size_t flat = estimated_memory(scene);
    scene.smooth_angle = 1;
    EXPECT_GE(estimated_memory(scene), flat + normals);
  }
}

// Other objects are as large as the object, which is compiled with them.
TEST(EstimatedMemoryTest, CountsOtherObjects) {
  SceneDescription scene;
  scene.object = make_shape("sphere");
  scene.boundary = Dielectric{};
  scene.lights = {ConstantLight{}};
  scene.camera = {.origin = {0, 0.5, -5}, .target = {0, 0.5, 0}};
  scene.film = {8, 8, Channel::kLuminance};
  const size_t alone = estimated_memory(scene);
  Mesh other = make_shape("smooth_star");
  for (Vec3f& v : other.vertices) v.x += 2;
  scene.other_objects = {{other, {3, 0.5, 0}, Dielectric{}, 1}};
  const size_t both = estimated_memory(scene);
  EXPECT_GT(both, alone);
  EXPECT_GT(both, Grid::most_memory(scene.object.triangles.size() + other.triangles.size()));
  EXPECT_LE(Scene(scene).memory(), both);
  scene.compiled_object = compile_object(make_shape("sphere"), "object");
  EXPECT_GE(estimated_memory(scene), both);
}

// ---- Stopping --------------------------------------------------------------------------------

double cpu_seconds(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// The processor time that a thread spends in `work` from a stop, asked for after `after` seconds of
// it, until it has ended. Below 0 if it ended before.
double time_to_stop(double after, const std::function<void(std::stop_token)>& work) {
  std::atomic<bool> started = false, ended = false;
  double end = 0;
  bool cancelled = false;
  std::stop_source source;
  std::thread worker([&] {
    started = true;
    try {
      work(source.get_token());
    } catch (const Error& error) {
      cancelled = error.kind() == ErrorKind::kCancelled;
    }
    end = cpu_seconds(CLOCK_THREAD_CPUTIME_ID);
    ended = true;
    while (!source.stop_requested()) {  // the clock of a thread ends with it
      std::this_thread::yield();
    }
  });
  while (!started) std::this_thread::yield();
  clockid_t clock{};
  pthread_getcpuclockid(worker.native_handle(), &clock);
  double asked = 0;
  do {
    asked = cpu_seconds(clock);
  } while (asked < after && !ended);
  source.request_stop();
  worker.join();
  return cancelled ? end - asked : -1;
}

void expect_stops(const std::function<void(std::stop_token)>& work) {
  const double start = cpu_seconds(CLOCK_THREAD_CPUTIME_ID);
  work({});
  const double whole = cpu_seconds(CLOCK_THREAD_CPUTIME_ID) - start;
  int stopped = 0;
  for (int i = 0; i < 6; ++i) {
    const double taken = time_to_stop(whole * i / 6, work);
    EXPECT_LT(taken, 0.05) << "asked after " << i << " sixths of " << whole << " s";
    stopped += taken >= 0 ? 1 : 0;
  }
  EXPECT_GE(stopped, 3);  // the last may come too late
}

TEST(GridTest, StopsAtAnyMoment) {
  for (const Mesh& mesh : {cone_fan(40'000), needles(10'000)}) {
    expect_stops([&](const std::stop_token& stop) { Grid(mesh, stop); });
    expect_stops([&](const std::stop_token& stop) { DepthGrid(mesh, stop); });
    const DepthGrid depth_grid(mesh);
    expect_stops([&](const std::stop_token& stop) { CellNormals(mesh, depth_grid, stop); });
    expect_stops([&](const std::stop_token& stop) {
      for (int i = 0; i < 30; ++i) CornerNormals(mesh, {{0, 0.5}}, stop);  // a few ms each
    });
  }
}

}  // namespace
}  // namespace itn::testing
