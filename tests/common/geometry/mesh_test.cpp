#include "common/geometry/mesh.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <ctime>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "client/geometry/mesh_file.h"
#include "common/error.h"
#include "common/geometry/shapes.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace std::string_literals;
using namespace testing;

// The unit cube centred over the origin, y in [0, 1].
Mesh cube() {
  return make_shape("cube");
}

Mesh scaled_about(const Mesh& mesh, double s, Vec3d center) {
  return transformed(mesh, {s, 0, 0, center.x, 0, s, 0, center.y - 0.5 * s, 0, 0, s, center.z});
}

Mesh reversed(Mesh mesh) {
  for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

Mesh together(Mesh a, const Mesh& b) {
  const auto base = static_cast<uint32_t>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& t : b.triangles) a.triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
  return a;
}

// A torus of n x n quads around the y axis.
Mesh torus_grid(uint32_t n) {
  Mesh mesh;
  for (uint32_t i = 0; i < n; ++i) {
    for (uint32_t j = 0; j < n; ++j) {
      const double a = 2 * std::numbers::pi * i / n, b = 2 * std::numbers::pi * j / n;
      const double r = 2 + std::cos(b);
      mesh.vertices.push_back(Vec3f(Vec3d{r * std::cos(a), std::sin(b), r * std::sin(a)}));
      const uint32_t p = i * n + j, q = (i + 1) % n * n + j;
      const uint32_t r1 = (i + 1) % n * n + (j + 1) % n, s = i * n + (j + 1) % n;
      mesh.triangles.push_back({p, s, r1});
      mesh.triangles.push_back({p, r1, q});
    }
  }
  return mesh;
}

TEST(Mesh, NormalizedStandsOnTheGroundWithLongestSideOne) {
  const Mesh mesh = transformed(cube(), {2, 0, 0, 5, 0, 4, 0, -7, 0, 0, 1, 11});
  const Bounds box = bounds(normalized(mesh));
  EXPECT_EQ(box.min, (Vec3f{-0.25F, 0, -0.125F}));
  EXPECT_EQ(box.max, (Vec3f{0.25F, 1, 0.125F}));
}

TEST(Mesh, TransformIsRowByRowWithTheTranslationLast) {
  const Mesh mesh{{{1, 2, 3}}, {}};
  const Mesh result = transformed(mesh, {1, 10, 100, 0.5, 2, 0, 0, 0, 0, 0, -1, 0});
  EXPECT_EQ(result.vertices[0], (Vec3f{321.5F, 2, -3}));
}

TEST(Mesh, WeldingMergesEqualPositionsAndDropsWhatIsLeftOver) {
  Mesh soup;
  const Mesh solid = cube();
  for (const auto& t : solid.triangles) {
    const auto base = static_cast<uint32_t>(soup.vertices.size());
    for (const uint32_t v : t) soup.vertices.push_back(solid.vertices[v]);
    soup.triangles.push_back({base, base + 1, base + 2});
  }
  soup.vertices.push_back({9, 9, 9});   // of no triangle
  soup.triangles.push_back({0, 1, 1});  // of no area
  soup.vertices[5].x += 0.0F * -1;      // -0 equals 0
  const Mesh mesh = welded(soup);
  EXPECT_EQ(mesh.vertices.size(), 8U);
  EXPECT_EQ(mesh.triangles.size(), 12U);
  validate_closed(mesh, "cube");
}

TEST(Mesh, VolumeAndWindingNumber) {
  EXPECT_NEAR(signed_volume(cube()), 1, 1e-6);
  EXPECT_NEAR(signed_volume(reversed(cube())), -1, 1e-6);
  EXPECT_NEAR(winding_number(cube(), {0.3, 0.4, -0.2}), 1, 1e-12);
  EXPECT_NEAR(winding_number(cube(), {0.3, 1.4, -0.2}), 0, 1e-12);
  EXPECT_NEAR(winding_number(reversed(cube()), {0.3, 0.4, -0.2}), -1, 1e-12);
}

TEST(ValidateClosed, AcceptsSolidsCavitiesAndIslands) {
  const Vec3d middle{0, 0.5, 0};
  validate_closed(cube(), "cube");
  const Mesh shell = together(cube(), reversed(scaled_about(cube(), 0.8, middle)));
  validate_closed(shell, "shell");
  EXPECT_NEAR(signed_volume(shell), 1 - 0.512, 1e-6);
  validate_closed(together(shell, scaled_about(cube(), 0.5, middle)), "a solid in a cavity");
  validate_closed(together(cube(), scaled_about(cube(), 1, {3, 0.5, 0})), "two solids");
}

// Two boxes, in either order of their triangles, as they are and turned, so that coordinates are
// rounded.
void expect_pair(const Mesh& a, const Mesh& b, bool accepted) {
  const double c = std::cos(0.7), s = std::sin(0.7);
  const Affine turn = {c, -s, 0, 3, c * s, c * c, -s, -2, s * s, s * c, c, 5};
  for (const Mesh& mesh : {together(a, b), together(b, a), transformed(together(a, b), turn),
                           transformed(together(b, a), turn)}) {
    for (const Mesh& pair : {mesh, welded(mesh)}) {
      if (accepted) {
        EXPECT_NO_THROW(validate_closed(pair, "pair"));
      } else {
        EXPECT_THROW(validate_closed(pair, "pair"), Error);
      }
    }
  }
}

Mesh box(Vec3d low, Vec3d high) {
  const Vec3d size = high - low;
  return transformed(cube(), {size.x, 0, 0, low.x + size.x / 2, 0, size.y, 0, low.y, 0, 0, size.z,
                              low.z + size.z / 2});
}

TEST(ValidateClosed, PartsThatOverlapAreRefusedInAnyOrder) {
  const Mesh unit = box({0, 0, 0}, {1, 1, 1});
  const auto refused = [&](const char* what, const Mesh& other) {
    SCOPED_TRACE(what);
    expect_pair(unit, other, false);
  };
  refused("corners in one another", box({0.5, 0.5, 0.5}, {1.5, 1.5, 1.5}));
  refused("a face in common planes", box({0.5, 0, 0}, {1.5, 1, 1}));
  refused("a shared corner", box({0, 0, 0}, {0.5, 0.5, 2}));
  refused("a shared face", box({0, 0, 0}, {0.5, 1, 1}));
  refused("a cross: no corner in the other", box({0.25, -1, 0.25}, {0.75, 2, 0.75}));
  refused("the same", unit);
  refused("the same but for rounding", scaled_about(unit, 1 + 1e-7, {0, 0, 0}));
  refused("the same, a little moved", box({1e-3, 1e-3, 1e-3}, {1.001, 1.001, 1.001}));
  refused("by a thousandth", box({0.999, 0.2, 0.2}, {2, 0.8, 0.8}));
  refused("a cavity that breaks through", reversed(box({0.25, -0.1, 0.25}, {0.5, 0.5, 0.5})));
  refused("a wall without thickness", reversed(box({0.25, 0, 0.25}, {0.5, 0.5, 0.5})));
  refused("inside", box({0.25, 0.25, 0.25}, {0.5, 0.5, 0.5}));
  refused("inside, on a face", box({0.25, 0, 0.25}, {0.5, 0.5, 0.5}));
  refused("around", box({-1, -1, -1}, {2, 2, 2}));
}

// Solids may overlap: two boxes side by side, of which each reaches into the other.
TEST(ValidateClosed, OverlapIsNamedWhereItIs) {
  const Mesh both = together(box({-0.5, 0, -0.5}, {0.5, 1, 0.5}), box({0, 0, -0.5}, {1, 1, 0.5}));
  try {
    validate_closed(both, "both");
    FAIL() << "accepted";
  } catch (const Error& error) {
    const std::string message = error.what();
    const size_t at = message.find("near (");
    ASSERT_NE(at, std::string::npos) << message;
    const double x = std::stod(message.substr(at + 6));
    EXPECT_TRUE(x >= 0 && x <= 0.5) << message;
  }
}

TEST(ValidateClosed, PartsMayTouch) {
  const Mesh unit = box({0, 0, 0}, {1, 1, 1});
  const auto accepted = [&](const char* what, const Mesh& other) {
    SCOPED_TRACE(what);
    expect_pair(unit, other, true);
  };
  accepted("a face", box({1, 0, 0}, {2, 1, 1}));
  accepted("part of a face", box({1, 0.25, 0.25}, {2, 0.5, 0.75}));
  accepted("an edge", box({1, 1, 0}, {2, 2, 1}));
  accepted("a corner", box({1, 1, 1}, {2, 2, 2}));
  accepted("nearly", box({1.0001, 0, 0}, {2, 1, 1}));
  accepted("far", box({5, 0, 0}, {6, 1, 1}));
  accepted("a cavity", reversed(box({0.25, 0.25, 0.25}, {0.5, 0.5, 0.5})));
  accepted("edges across", box({0.25, 1, -1}, {0.75, 2, 2}));
}

TEST(ValidateClosed, RefusesRepeatedTriangles) {
  Mesh mesh = cube();
  const auto once = mesh.triangles;
  mesh.triangles.insert(mesh.triangles.end(), once.begin(), once.end());
  expect_error(ErrorKind::kInvalidInput, {"pair has triangles that overlap, or are there twice"},
               [&] { validate_closed(mesh, "pair"); });
}

// Comparing every part with every triangle would take hours.
TEST(ValidateClosed, ManyPartsTakeSeconds) {
  Mesh mesh;
  for (int i = 0; i < 30'000; ++i) {
    const Mesh part = scaled_about(cube(), 0.9, {double(i % 30), i / 30 % 30 + 0.5, i / 900 + 0.0});
    const auto base = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
    for (const auto& t : part.triangles) {
      mesh.triangles.push_back({t[0] + base, t[1] + base, t[2] + base});
    }
  }
  const auto start = std::clock();  // of the processor, not of a busy machine
  validate_closed(mesh, "parts");
  EXPECT_LT(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC, 10);
}

TEST(ValidateClosed, StopsWhenAsked) {
  std::stop_source source;
  source.request_stop();
  expect_error(ErrorKind::kCancelled, {},
               [&] { validate_closed(torus_grid(100), "torus", source.get_token()); });
}

TEST(ValidateClosed, CubesThatShareAnEdgeAreClosed) {
  const Mesh pair = welded(together(cube(), scaled_about(cube(), 1, {1, 1.5, 0})));
  EXPECT_EQ(pair.vertices.size(), 14U);
  validate_closed(pair, "pair");
}

// In linear time: a sort of all edges or a map would take seconds.
TEST(ValidateClosed, TakesWellUnderASecondForAMillionTriangles) {
  const Mesh mesh = torus_grid(708);
  ASSERT_GT(mesh.triangles.size(), 1'000'000U);
  const auto start = std::chrono::steady_clock::now();
  validate_closed(mesh, "torus");
  // Some 0.07 s optimised and idle; the limit leaves room for debug builds and busy machines.
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
}

// --- Bad meshes: a row each ---

struct BadMesh {
  const char* name;
  std::function<void(Mesh&)> spoil;  // of a cube
  std::vector<std::string> message;
};

const std::vector<BadMesh> kBadMeshes{
    {"empty", [](Mesh& m) { m = {}; }, {"the object has no triangles"}},
    {"nan",
     [](Mesh& m) { m.vertices[3].y = std::numeric_limits<float>::quiet_NaN(); },
     {"the object: vertex 3", "nan", "finite"}},
    {"index",
     [](Mesh& m) { m.triangles[5][1] = 8; },
     {"the object: triangle 5 refers to vertex 8, but there are 8"}},
    {"one_triangle_missing",
     [](Mesh& m) { m.triangles.erase(m.triangles.begin()); },
     {"the object is not closed: 3 open edges", "the first is between (-0.5, 0, -0.5) and"}},
    {"one_face_missing",
     [](Mesh& m) { m.triangles.resize(10); },
     {"the object is not closed: 4 open edges"}},
    {"one_triangle_turned",
     [](Mesh& m) { std::swap(m.triangles[0][0], m.triangles[0][1]); },
     {"the object has triangles of clashing orientation at 3 edges", "the first is between"}},
    {"inside_out",
     [](Mesh& m) { m = reversed(m); },
     {"the object is inside out", "encloses -1 mm^3", "counter-clockwise"}},
    {"second_part_inside_out",
     [](Mesh& m) {
       m = together(m, reversed(scaled_about(m, 1, {4, 0.5, 0})));
     },
     {"the object is inside out: the part at (3.5, 0, -0.5)"}},
    {"cavity_in_a_cavity",
     [](Mesh& m) {
       const Mesh hole = reversed(scaled_about(m, 0.8, {0, 0.5, 0}));
       const Mesh second = reversed(scaled_about(m, 0.6, {0, 0.5, 0}));
       m = together(together(m, hole), second);
     },
     {"the object is inside out"}},
    {"solid_in_a_solid",
     [](Mesh& m) {
       m = together(m, scaled_about(m, 0.5, {0, 0.5, 0}));
     },
     {"the object has a part at (-0.25, 0.25, -0.25) inside another part"}},
    {"flat",
     [](Mesh& m) {
       m = transformed(m, {1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0});
     },
     {"the object has a part that encloses no volume"}},
};

class BadMeshTest : public ::testing::TestWithParam<BadMesh> {};

TEST_P(BadMeshTest, IsRefused) {
  Mesh mesh = cube();
  GetParam().spoil(mesh);
  expect_error(ErrorKind::kInvalidInput, GetParam().message,
               [&] { validate_closed(mesh, "the object"); });
}

INSTANTIATE_TEST_SUITE_P(Table, BadMeshTest, ::testing::ValuesIn(kBadMeshes),
                         [](const auto& row) { return std::string(row.param.name); });

// --- Mesh files ---

// A tetrahedron of volume 1/6 in each format.
constexpr const char* kPly =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
constexpr const char* kObj =
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
constexpr const char* kStl =
    "solid t\n"
    "facet normal 0 0 -1\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet\n"
    "facet normal 0 -1 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet\n"
    "facet normal -1 0 0\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendloop\nendfacet\n"
    "facet normal 1 1 1\nouter loop\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\nendfacet\n"
    "endsolid t\n";
// A cube of quads, in two groups of different materials.
constexpr const char* kQuads =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
    "usemtl a\nf 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nusemtl b\nf 3 4 8 7\nf 1 5 8 4\nf 2 3 7 6\n";

// A tetrahedron with all that an OBJ file may have beside.
constexpr const char* kFullObj =
    "# by hand \\\nmtllib a.mtl\no t\ng all\ns 1\nv 0 0 0 1 1 1\nv +1 0 0 # C:\\models\\\r\nv 0 2 "
    "0 2\nvt 0 0\n"
    "vn 0 0 1\nusemtl a\nf 1/1 3/1/1 2//1 # the ground\nf 1 2 \\\n4\nv\t0 0 1\np 1\nl 1 2\nf 1 2\n"
    "f -4 -1 -2\nf 2 3 4";

struct MeshFile {
  const char* name;
  const char* file;
  const char* text;
  size_t vertices, triangles;
  double volume;
};

class MeshFormatTest : public ::testing::TestWithParam<MeshFile> {};

TEST_P(MeshFormatTest, IsReadAndWelded) {
  const TemporaryFolder folder;
  const Mesh mesh = load_mesh(folder.write(GetParam().file, GetParam().text));
  EXPECT_EQ(mesh.vertices.size(), GetParam().vertices);
  EXPECT_EQ(mesh.triangles.size(), GetParam().triangles);
  EXPECT_NEAR(signed_volume(mesh), GetParam().volume, 1e-6);
  validate_closed(mesh, "mesh");
}

INSTANTIATE_TEST_SUITE_P(Formats, MeshFormatTest,
                         ::testing::Values(MeshFile{"ply", "a.ply", kPly, 4, 4, 1.0 / 6},
                                           MeshFile{"obj", "a.obj", kObj, 4, 4, 1.0 / 6},
                                           MeshFile{"full_obj", "a.obj", kFullObj, 4, 4, 1.0 / 6},
                                           MeshFile{"stl", "a.stl", kStl, 4, 4, 1.0 / 6},
                                           MeshFile{"upper_case", "A.PLY", kPly, 4, 4, 1.0 / 6},
                                           MeshFile{"quads", "quads.obj", kQuads, 8, 12, 1}),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(MeshFileTest, EncodedPlyIsReadBitForBit) {
  const TemporaryFolder folder;
  const Mesh mesh = make_shape("figure");
  const Mesh read = load_mesh(folder.write("figure.ply", encode_ply(mesh)));
  EXPECT_EQ(read.triangles.size(), mesh.triangles.size());
  // Reading may number the vertices otherwise.
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (size_t i = 0; i < 3; ++i) {
      ASSERT_EQ(read.vertices[read.triangles[t][i]], mesh.vertices[mesh.triangles[t][i]]);
    }
  }
}

TEST(MeshFileTest, EncodedPlyMayHaveNormals) {
  const TemporaryFolder folder;
  const Mesh mesh = make_shape("cube");
  const std::vector<std::array<Vec3f, 3>> up(mesh.triangles.size(),
                                             {Vec3f{0, 1, 0}, Vec3f{0, 1, 0}, Vec3f{0, 1, 0}});
  const std::string ply = encode_ply(mesh, up);
  EXPECT_THAT(ply, ::testing::HasSubstr("property float nz"));
  const Mesh read = load_mesh(folder.write("cube.ply", ply));  // welds its corners
  EXPECT_EQ(read.vertices.size(), mesh.vertices.size());
  EXPECT_DOUBLE_EQ(signed_volume(read), signed_volume(mesh));
}

// The first number of a binary file may begin with a byte that looks like a line end. Properties
// and elements that a mesh does not need are passed over.
TEST(MeshFileTest, BinaryPlyOfEitherByteOrder) {
  const float first = std::bit_cast<float>(0x3F000A0AU);  // 0.5 and a bit
  const TemporaryFolder folder;
  for (const bool big : {false, true}) {
    std::string ply = std::string("ply\nformat binary_") + (big ? "big" : "little") +
                      "_endian 1.0\nelement edge 1\nproperty list uchar short ends\n"
                      "element vertex 4\nproperty float x\nproperty uchar red\n"
                      "property float64 y\nproperty float z\nelement face 4\n"
                      "property list uint16 int vertex_index\nend_header\n";
    const auto put = [&](auto... values) {
      const auto put_one = [&](auto value) {
        auto bytes = std::bit_cast<std::array<char, sizeof value>>(value);
        if (big) std::ranges::reverse(bytes);
        ply.append(bytes.begin(), bytes.end());
      };
      (put_one(values), ...);
    };
    put(uint8_t{2}, int16_t{0}, int16_t{-1});
    for (const auto& [x, y, z] : {std::array{first, 0.0F, 0.0F}, {1, 0, 0}, {1, 1, 0}, {1, 0, 1}}) {
      put(x, uint8_t{255}, double{y}, z);
    }
    for (const auto& [a, b, c] : {std::array{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}) {
      put(uint16_t{3}, a, b, c);
    }
    const Mesh mesh = load_mesh(folder.write("a.ply", ply));
    const std::vector<Vec3f> by_first_use = {{first, 0, 0}, {1, 1, 0}, {1, 0, 0}, {1, 0, 1}};
    EXPECT_EQ(mesh.vertices, by_first_use);
    EXPECT_EQ(mesh.triangles,
              (decltype(mesh.triangles){{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {2, 1, 3}}));
    ply.pop_back();
    expect_error(ErrorKind::kDataLoss, {"it ends in number 3 of 4 of element \"face\""},
                 [&] { load_mesh(folder.write("a.ply", ply)); });
  }
}

// A text number is rounded once: the nearest float, whatever it is written like.
TEST(MeshFileTest, TextNumbersAreTheNearestFloats) {
  const TemporaryFolder folder;
  const Mesh mesh =
      load_mesh(folder.write("a.obj",
                             "v 0.1 16777217.000001 +1e-50\nv 1.00000006 .5e1 -0\n"
                             "v 3.4028234663852886e38 1E2 0.30000001192092896\nf 1 2 3\n"));
  EXPECT_EQ(
      mesh.vertices,
      (std::vector<Vec3f>{{0.1F, 16777218, 0}, {1.0000001F, 5, 0}, {3.4028235e38F, 100, 0.3F}}));
}

TEST(MeshFileTest, BinaryStlMayBeginLikeAText) {
  const TemporaryFolder folder;
  std::string stl = "solid" + std::string(75, ' ') + "\1\0\0\0"s + std::string(12, '\0');
  for (const float v : {0.F, 0.F, 0.F, 1.F, 0.F, 0.F, 0.F, 1.F, 0.F}) {
    stl.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  const Mesh mesh = load_mesh(folder.write("a.stl", stl + std::string(2, '\0')));
  EXPECT_EQ(mesh.vertices, (std::vector<Vec3f>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
}

// A prism over a polygon of n corners, counter-clockwise, of height 1.
std::string prism(const std::vector<std::array<double, 2>>& base) {
  std::string obj, bottom = "f", top = "f", sides;
  const size_t n = base.size();
  for (const auto& [x, y] : base) obj += fmt::format("v {} {} {}\n", x, y, x + 2 * y);
  for (const auto& [x, y] : base) obj += fmt::format("v {} {} {}\n", x, y, x + 2 * y + 1);
  for (size_t i = 0; i < n; ++i) {
    bottom += fmt::format(" {}", n - i);
    top += fmt::format(" {}", n + 1 + i);
    const size_t j = (i + 1) % n;
    sides += fmt::format("f {} {} {} {}\n", i + 1, j + 1, n + j + 1, n + i + 1);
  }
  return obj + bottom + "\n" + top + "\n" + sides;
}

// Files as editors and other programs write them.
TEST(MeshFileTest, ReadsByteOrderMarksCapitalsAndWordsApart) {
  const TemporaryFolder folder;
  const Mesh obj =
      load_mesh(folder.write("a.obj", "\xef\xbb\xbfv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"));
  EXPECT_EQ(obj.vertices.size(), 3U);
  const std::string facet =
      "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n";
  const std::string text =
      "solid a\n" + facet + "end loop\nend facet\n" + facet + "endloop\nendfacet\nendsolid a\n";
  std::string capitals = text;
  for (char& c : capitals) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  for (const std::string& each : {text, capitals, "\xef\xbb\xbf  " + text}) {
    EXPECT_EQ(load_mesh(folder.write("a.stl", each)).triangles.size(), 2U) << each;
  }
  expect_error(ErrorKind::kInvalidInput, {"strips.ply", "triangles as strips"}, [&] {
    load_mesh(folder.write("strips.ply",
                           "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                           "property float y\nproperty float z\nelement tristrips 1\n"
                           "property list int int vertex_indices\nend_header\n"
                           "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"));
  });
}

TEST(MeshFileTest, FacesMayBeConcavePolygons) {
  const TemporaryFolder folder;
  const auto expect_area = [&](const char* name, double area,
                               const std::vector<std::array<double, 2>>& base) {
    SCOPED_TRACE(name);
    const Mesh mesh = load_mesh(folder.write("a.obj", prism(base)));
    EXPECT_EQ(mesh.triangles.size(), 4 * base.size() - 4);
    EXPECT_NEAR(signed_volume(mesh), area, 1e-6);
    validate_closed(mesh, name);
    double top = 0;  // more than the face if triangles overlap
    for (const auto& [a, b, c] : mesh.triangles) {
      const Vec3d p(mesh.vertices[a]), q(mesh.vertices[b]), r(mesh.vertices[c]);
      top += std::max(0.0, cross(q - p, r - p).z / 2);
    }
    EXPECT_NEAR(top, area, 1e-6);
  };
  expect_area("dart", 1, {{0, 0}, {1, 2}, {0, 1}, {-1, 2}});
  expect_area("dart from its notch", 1, {{0, 1}, {-1, 2}, {0, 0}, {1, 2}});
  expect_area("L", 3, {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}});
  expect_area("corners in the middle of sides", 4,
              {{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}});
  expect_area("comb", 10.25, {{0, 0}, {7, 0}, {7, 3}, {6, 1}, {5, 3}, {4, 1}, {3, 3}, {2, 0.5}});
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

std::string many_corners(int count) {
  std::string corners;
  for (int i = 0; i < count; ++i) corners += i % 2 == 0 ? " 1" : " 2";
  return corners;
}

struct BadMeshFile {
  const char* name;
  const char* file;
  std::optional<std::string> text;
  ErrorKind kind;
  std::vector<std::string> message;
};

const std::vector<BadMeshFile> kBadMeshFiles{
    {"missing", "a.ply", {}, ErrorKind::kIo, {"cannot read the mesh", "a.ply"}},
    {"other_format", "a.fbx", kPly, ErrorKind::kInvalidInput, {"a.fbx", ".ply, .obj or .stl"}},
    {"no_extension", "mesh", kPly, ErrorKind::kInvalidInput, {".ply, .obj or .stl"}},
    {"empty", "a.ply", "", ErrorKind::kDataLoss, {"a.ply was cut short"}},
    {"garbage", "a.ply", "what is this", ErrorKind::kInvalidInput, {"a.ply"}},
    {"cut_in_the_header",
     "a.ply",
     std::string(kPly).substr(0, 21),
     ErrorKind::kDataLoss,
     {"a.ply was cut short", "end_header"}},
    {"cut_in_the_vertices",
     "a.ply",
     std::string(kPly).substr(0, 157),
     ErrorKind::kDataLoss,
     {"a.ply was cut short", "promises 4 of element \"vertex\""}},
    {"cut_in_the_faces",
     "a.ply",
     std::string(kPly).substr(0, 203),
     ErrorKind::kDataLoss,
     {"a.ply was cut short", "it ends in number 3 of 4 of element \"face\""}},
    {"promises_more_than_it_holds",
     "a.ply",
     replaced(kPly, "vertex 4", "vertex 70000000"),
     ErrorKind::kDataLoss,
     {"promises 70000000 of element \"vertex\""}},
    {"promises_a_long_list",
     "a.ply",
     replaced(kPly, "3 1 2 3", "4000000000 1 2 3"),
     ErrorKind::kDataLoss,
     {"a.ply was cut short"}},
    {"no_properties",
     "a.ply",
     replaced(kPly, "end_header", "element edge 4000000000\nend_header"),
     ErrorKind::kInvalidInput,
     {"\"edge\" has no properties"}},
    {"a_byte_where_a_number_should_be",
     "a.ply",
     replaced(kPly, "3 0 3 2", "3 \x01 3 2"),
     ErrorKind::kInvalidInput,
     {"number 2 of element \"face\""}},
    {"stl_that_promises_more",
     "a.stl",
     std::string(80, ' ') + std::string("\x05\0\0\x08", 4) + std::string(50, '\0'),
     ErrorKind::kDataLoss,
     {"a.stl was cut short", "134217733 triangles"}},
    // 84 + 50 x 85899347 is 134 but for 2^32.
    {"stl_that_promises_more_in_32_bits",
     "a.stl",
     "solid" + std::string(75, ' ') + std::string("\x53\xB8\x1E\x05", 4) + std::string(54, '\0'),
     ErrorKind::kDataLoss,
     {"a.stl was cut short"}},
    {"stl_vertex_of_two",
     "a.stl",
     replaced(kStl, "vertex 0 1 0", "vertex 0 1"),
     ErrorKind::kInvalidInput,
     {"a.stl: line 5: there is \"\" where a number should be"}},
    {"stl_facet_of_two",
     "a.stl",
     replaced(kStl, "vertex 0 1 0\n", ""),
     ErrorKind::kInvalidInput,
     {"a.stl: line 6: a facet has less than three vertices"}},
    {"stl_facet_of_four",
     "a.stl",
     replaced(kStl, "endloop", "vertex 1 1 1\nendloop"),
     ErrorKind::kInvalidInput,
     {"a.stl: line 7: a facet has more than three vertices"}},
    {"stl_cut_in_a_facet",
     "a.stl",
     std::string(kStl).substr(0, 52),
     ErrorKind::kDataLoss,
     {"a.stl was cut short: it ends in a facet"}},
    {"no_faces",
     "a.obj",
     "v 0 0 0\nv 1 0 0\nv 0 1 0\n",
     ErrorKind::kInvalidInput,
     {"a.obj: it has no faces"}},
    {"obj_of_damaged_materials",
     "a.obj",
     "mtllib a.\0\0map_emissivemtl\no cube\nvt 0 0\nvn 0 map_Ps1 0\nf 1 2 ?\n"s,
     ErrorKind::kInvalidInput,
     {"a.obj: line 5: the face has the corner \"?\""}},
    {"obj_vertex_of_two",
     "a.obj",
     "v 0 0 0\nv 1 0 # 3\n",
     ErrorKind::kInvalidInput,
     {"a.obj: line 2: the vertex has less than three coordinates"}},
    {"obj_vertex_of_words",
     "a.obj",
     "v 0 0 zero\n",
     ErrorKind::kInvalidInput,
     {"a.obj: line 1: there is \"zero\" where a number should be"}},
    {"obj_index",
     "a.obj",
     replaced(kObj, "f 1 4 3", "f 1 5 3"),
     ErrorKind::kInvalidInput,
     {"a.obj: line 7: the face refers to vertex 5; there are 4"}},
    {"obj_index_backwards",
     "a.obj",
     replaced(kObj, "f 1 4 3", "f 1 -5 3"),
     ErrorKind::kInvalidInput,
     {"a.obj: line 7: the face refers to vertex -5; there are 4"}},
    {"too_many_corners",
     "a.ply",
     replaced(kPly, "3 1 2 3", "1025 1 2 3" + many_corners(1022)),
     ErrorKind::kInvalidInput,
     {"a.ply", "face 3 has a list of 1025 items", "at most 1024"}},
    {"obj_too_many_corners",
     "a.obj",
     replaced(kObj, "f 1 4 3", "f 1 4 3" + many_corners(1022)),
     ErrorKind::kInvalidInput,
     {"a.obj: line 7: the face has 1025 corners"}},
    {"index", "a.ply", replaced(kPly, "3 1 2 3", "3 1 2 9"), ErrorKind::kInvalidInput, {"a.ply"}},
    {"index_of_a_quad",
     "a.ply",
     replaced(kPly, "3 1 2 3", "4 1 2 3 700000"),
     ErrorKind::kInvalidInput,
     {"a.ply"}},
    {"nan",
     "a.ply",
     replaced(kPly, "0 1 0", "0 nan 0"),
     ErrorKind::kInvalidInput,
     {"a.ply", "finite"}},
};

class BadMeshFileTest : public ::testing::TestWithParam<BadMeshFile> {};

TEST_P(BadMeshFileTest, IsRefused) {
  const TemporaryFolder folder;
  if (GetParam().text) folder.write(GetParam().file, *GetParam().text);
  expect_error(GetParam().kind, GetParam().message,
               [&] { load_mesh(folder.path() / GetParam().file); });
}

INSTANTIATE_TEST_SUITE_P(Table, BadMeshFileTest, ::testing::ValuesIn(kBadMeshFiles),
                         [](const auto& row) { return std::string(row.param.name); });

TEST(MeshFileTest, OpensNoOtherFile) {
  const TemporaryFolder folder;
  const std::filesystem::path fifo = folder.path() / "a.mtl";
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);  // opening it would wait for ever
  const Mesh mesh = load_mesh(folder.write("a.obj", "mtllib a.mtl\n" + std::string(kObj)));
  EXPECT_EQ(mesh.triangles.size(), 4U);
  ASSERT_EQ(mkfifo((folder.path() / "b.obj").c_str(), 0600), 0);
  expect_error(ErrorKind::kIo, {"b.obj"}, [&] { load_mesh(folder.path() / "b.obj"); });
}

}  // namespace
}  // namespace itn
