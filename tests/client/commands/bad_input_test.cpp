// Bad input to the programs: each gives a clear message and the documented exit code.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "client/image/image.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scene_files.h"

namespace itn {
namespace {

using ::testing::HasSubstr;
using namespace testing;

using Arguments = std::vector<std::string>;

struct BadInput {
  const char* name;
  std::function<Arguments(const TemporaryFolder&)> command;
  int exit_code;
  std::vector<std::string> message;  // pieces of it
};

// ---- Commands ----------------------------------------------------------------------------------

// `changes` are flags with their values; they take the place of the usual ones.
Arguments render(const TemporaryFolder& folder, const std::string& scene_file,
                 const std::vector<std::pair<std::string, std::string>>& changes = {}) {
  std::map<std::string, std::string> flags = {{"--output", folder.path("out.exr")},
                                              {"--sigma-t", "5"},
                                              {"--albedo", "0.9"},
                                              {"--spp", "2"},
                                              {"--threads", "1"}};
  for (const auto& [flag, value] : changes) flags[flag] = value;
  Arguments command = {testing::kItn, "render", scene_file};
  for (const auto& [flag, value] : flags) command.push_back(flag + "=" + value);
  return command;
}

// Renders the usual scene with a part of it replaced.
auto scene_with(const std::string& from, const std::string& to) {
  return [=](const TemporaryFolder& folder) {
    return render(folder, folder.write("scene.textproto", replaced(kSceneFile, from, to)));
  };
}

// Renders the usual scene with another flag.
auto flag(const std::string& name, const std::string& value) {
  return [=](const TemporaryFolder& folder) {
    return render(folder, folder.write("scene.textproto", kSceneFile), {{name, value}});
  };
}

// The usual scene with a mesh file.
Arguments render_mesh(const TemporaryFolder& folder, const std::string& name,
                      const std::string& content) {
  folder.write(name, content);
  return render(folder, folder.write("scene.textproto", replaced(kSceneFile, "builtin: \"cube\"",
                                                                 "path: \"" + name + "\"")));
}

// A tetrahedron without its last face.
const char* const kOpenMesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\n";
const char* const kInsideOut =
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n";

std::string exr_with(const TemporaryFolder& folder, float value) {
  Image image;
  image.width = 4;
  image.height = 4;
  image.channels["Y"] = std::vector<float>(16, 1);
  image.channels["mask.Y"] = std::vector<float>(16, 1);
  image.channels["Y"][6] = value;
  write_exr(folder.path("image.exr"), image);
  return folder.path("image.exr");
}

const BadInput kBadInputs[] = {
    {"NoCommand", [](auto&) { return Arguments{testing::kItn}; }, 2, {"Usage", "render"}},
    {"UnknownCommand",
     [](auto&) {
       return Arguments{testing::kItn, "rendre"};
     },
     2,
     {"no command rendre; did you mean render?"}},
    {"NoScene",
     [](auto&) {
       return Arguments{testing::kItn, "render"};
     },
     2,
     {"itn: scene is required"}},
    {"UnknownFlag", flag("--frobnicate", "1"), 2, {"itn render has no flag --frobnicate"}},
    {"MisspeltFlag", flag("--sgima-t", "1"), 2, {"--sgima-t; did you mean --sigma-t?"}},
    {"NotANumber", flag("--spp", "many"), 2, {"--spp"}},
    {"NegativeSpp", flag("--spp", "-1"), 2, {"--spp"}},
    {"UnknownDerivative", flag("--derivatives", "sigma_t,ior"), 2, {"ior", "sigma_s_reduced"}},
    {"BadFilm", flag("--film", "128y96"), 2, {"--resolution: 128y96", "128x96"}},
    {"Albedo", flag("--albedo", "1.2"), 2, {"itn: --albedo: 1.2 is not a number in [0, 1]"}},
    {"AlbedoNan", flag("--albedo", "nan"), 2, {"itn: --albedo: nan is not a number in [0, 1]"}},
    {"G", flag("--g", "1"), 2, {"itn: --g: 1 is not a number in [-0.99, 0.99]"}},
    {"SigmaT", flag("--sigma-t", "-3"), 2, {"itn: --sigma-t: -3 is not a number in [1e-06, "}},
    {"SigmaTWithAComma",
     flag("--sigma-t", "30,5"),
     2,
     {"itn: --sigma-t: 2 numbers; it takes one", "decimals take a point"}},
    {"SppWithAComma", flag("--spp", "30,5"), 2, {"itn: --spp: 30,5 is not a whole number in"}},
    {"NoSamples", flag("--spp", "0"), 2, {"itn: --spp: 0 is not a whole number in [1, 1048576]"}},
    {"HalfASample", flag("--spp", "1.5"), 2, {"itn: --spp: 1.5 is not a whole number in [1, "}},
    {"NegativeSeed", flag("--seed", "-1"), 2, {"itn: --seed: -1 is not a whole number in [0, "}},
    {"NoEstimates",
     flag("--estimates", "0"),
     2,
     {"--estimates: 0 is not a whole number in [1, 16]"}},
    {"OtherTracer",
     flag("--tracer", "photons"),
     2,
     {"itn: --tracer: photons is not one of wavefront, reference"}},
    {"PilotOfTheReference",
     [](auto& folder) {
       return render(folder, folder.write("scene.textproto", kSceneFile),
                     {{"--tracer", "reference"}, {"--pilot-spp", "4"}});
     },
     2,
     {"--tracer reference", "--pilot-spp 4"}},
    {"NoiseWithAPilot",
     [](auto& folder) {
       return render(folder, folder.write("scene.textproto", kSceneFile),
                     {{"--noise", "1%"}, {"--pilot-spp", "4"}});
     },
     2,
     {"--noise and --time have no --pilot-spp"}},
    {"NoiseOfNothing", flag("--noise", "0%"), 2, {"--noise: 0 is not a number in [0.0001, 1]"}},
    {"TimeWithoutUnit", flag("--time", "5x"), 2, {"--time: 5x is not a time, as 10s, 2m or 1h"}},
    {"FlagGivenTwice",
     [](auto& folder) {
       Arguments command = render(folder, folder.write("scene.textproto", kSceneFile));
       command.push_back("--spp=3");
       return command;
     },
     2,
     {"itn: --spp is given more than once"}},
    {"TwoScenes",
     [](auto& folder) {
       Arguments command = render(folder, folder.write("scene.textproto", kSceneFile));
       command.push_back("another");
       return command;
     },
     2,
     {"itn: ", "another"}},
    {"RepeatedDerivative", flag("--derivatives", "g,g"), 3, {"g again"}},
    {"TooManyEstimates", flag("--estimates", "3"), 2, {"--estimates 3 and --spp 2"}},
    {"BillionPixels", flag("--film", "40000x25000"), 7, {"1000000000", "at most"}},
    {"NoWorker", flag("--workers", "127.0.0.1:1"), 5, {"no render worker answers", "127.0.0.1:1"}},
    {"NoAddressOfAWorker", flag("--workers", "host"), 2, {"\"host\"", "HOST:PORT"}},
    {"NoNameOfWorkers", flag("--workers", "dns:///host"), 2, {"\"dns:///host\"", "NAME:PORT"}},
    {"NoFileOfWorkers", flag("--workers", "file:/nowhere/workers"), 4, {"/nowhere/workers"}},
    {"BadLineInAFileOfWorkers",
     [](auto& folder) {
       const std::string file = folder.write("workers", "# two\nhost\n");
       return render(folder, folder.write("scene.textproto", kSceneFile),
                     {{"--workers", "file:" + file}});
     },
     3,
     {"workers:2: \"host\" is not the address of a server"}},
    {"NoSuchScene",
     [](auto& folder) { return render(folder, folder.path("missing.textproto")); },
     4,
     {"missing.textproto"}},
    {"EmptyScene",
     [](auto& folder) { return render(folder, folder.write("scene.textproto", "")); },
     3,
     {"scene.textproto: the scene file is empty"}},
    {"EndlessScene",
     [](auto& folder) { return render(folder, "/dev/zero"); },
     4,
     {"the scene /dev/zero: it is a device"}},
    {"NoSuchFolder",
     [](auto& folder) {
       return render(folder, folder.write("scene.textproto", kSceneFile),
                     {{"--output", folder.path("no/such/folder/out.exr")}});
     },
     4,
     {"no/such/folder"}},
    {"UnknownField",
     scene_with("fov_degrees", "fow_degrees"),
     3,
     {"scene.textproto:5:", "fow_degrees"}},
    {"Syntax", scene_with("film {", "film {{"), 3, {"scene.textproto:6:"}},
    {"NoLight", scene_with("lights { constant { radiance: 1 } }", ""), 3, {"scene.lights"}},
    {"UnknownShape", scene_with("cube\"", "teapot\""), 3, {"teapot", "cube"}},
    {"SceneValue",
     scene_with("fov_degrees: 22", "fov_degrees: 200"),
     3,
     {"scene.camera.fov_degrees is 200", "(0, 179)"}},
    {"NoSuchMesh", scene_with("builtin: \"cube\"", "path: \"missing.ply\""), 4, {"missing.ply"}},
    {"OpenMesh",
     [](auto& folder) { return render_mesh(folder, "open.obj", kOpenMesh); },
     3,
     {"open.obj is not closed: 3 open edges", "path: \"open.obj\" repair: true"}},
    {"OpenMeshOfADataset",
     [](auto& folder) {
       folder.write("open.obj", kOpenMesh);
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--shapes", folder.path("")};
     },
     3,
     {"open.obj is not closed: 3 open edges", "can be repaired: --repair"}},
    {"NoPanorama",
     [](auto& folder) {
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--panoramas",
                        folder.path("")};
     },
     3,
     {"holds no EXR file"}},
    {"PanoramaThatIsNone",
     [](auto& folder) {
       folder.write("room.exr", "not an image");
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--panoramas",
                        folder.path("")};
     },
     3,
     {"no panorama in ", "room.exr is not a complete OpenEXR image"}},
    {"PanoramaThatIsSquare",
     [](auto& folder) {
       exr_with(folder, 1);
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--panoramas",
                        folder.path("")};
     },
     3,
     {"image.exr has 4 x 4 pixels", "twice as wide as high"}},
    {"PanoramasOfNoFolder",
     [](auto& folder) {
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--config",
                        folder.write("file.textproto", "lights { panoramas {} }")};
     },
     3,
     {"panoramas.folder is empty"}},
    {"EmitterOfANegativeSize",
     [](auto& folder) {
       return Arguments{
           testing::kItn, "dataset", folder.path("data"), "--config",
           folder.write("file.textproto",
                        "lights { studio { emitter { size_degrees { fixed: -5 } } } }")};
     },
     3,
     {"lights[0].studio.emitter.size_degrees is -5; it must be in [4, 120]"}},
    {"MisspeltFieldOfAStudio",
     [](auto& folder) {
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--config",
                        folder.write("file.textproto", "lights {\n  studio { wals {} }\n}")};
     },
     3,
     {"file.textproto:2:", "wals"}},
    {"FaceOfNoVertex",
     [](auto& folder) {
       return render_mesh(folder, "bad.obj", "v 0 0 0\nv 1 0 0\n# corners\nv 0 1 0\nf 1 3 9\n");
     },
     3,
     {"bad.obj: line 5: the face refers to vertex 9; there are 3"}},
    {"FaceOfNoVertexBackwards",
     [](auto& folder) {
       return render_mesh(folder, "bad.obj",
                          "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2 3\nf -1//1 -2//1 -9//1\n");
     },
     3,
     {"bad.obj: line 5: the face refers to vertex -9; there are 3"}},
    {"OneImage",
     [](auto& folder) {
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--count", "1"};
     },
     2,
     {"itn: --count: 1 is not a whole number in [2, "}},
    {"NoTestImage",
     [](auto& folder) {
       return Arguments{testing::kItn,     "dataset", folder.path("data"), "--count", "4",
                        "--test-fraction", "0.1"};
     },
     3,
     {"of 4 images, with a test fraction of 0.1, 0 are to test with", "more images"}},
    {"RangeOfNan",
     [](auto& folder) {
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--sigma-t", "nan", "3"};
     },
     2,
     {"itn: --sigma-t: nan is not a number in [1e-06, "}},
    {"HalfARange",
     [](auto& folder) {
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--sigma-t", "3"};
     },
     2,
     {"itn: --sigma-t", "MIN MAX"}},
    {"AzimuthNan",
     [](auto& folder) {
       return Arguments{testing::kItn, "dataset", folder.path("data"), "--train-azimuths", "1,nan"};
     },
     2,
     {"itn: --train-azimuths: nan is not a number in [-360, 360]"}},
    {"ResumeNothing",
     [](auto& folder) {
       return Arguments{testing::kItn, "train", "--resume", "-o", folder.path("nope")};
     },
     4,
     {"there is no run in", "nope to continue", "begins one"}},
    {"EpochsNan",
     [](auto& folder) {
       return Arguments{testing::kItn,      "train",    "data", "-o",
                        folder.path("run"), "--epochs", "nan"};
     },
     2,
     {"itn: --epochs: nan is not a number in (0, 1000000)"}},
    {"LambdaNan",
     [](auto& folder) {
       return Arguments{testing::kItn,      "train",    "data", "-o",
                        folder.path("run"), "--lambda", "nan"};
     },
     2,
     {"itn: --lambda: nan is not a number in [0, "}},
    {"InsideOut",
     [](auto& folder) { return render_mesh(folder, "inside.obj", kInsideOut); },
     3,
     {"inside out"}},
    {"NotAMesh",
     [](auto& folder) { return render_mesh(folder, "bad.ply", "not a mesh"); },
     3,
     {"bad.ply"}},
    {"DamagedMap",
     [](auto& folder) {
       folder.write("map.exr", "not an image");
       return render(folder, folder.write("scene.textproto",
                                          replaced(kSceneFile, "constant { radiance: 1 }",
                                                   "environment_map { path: \"map.exr\" }")));
     },
     6,
     {"map.exr"}},
    {"ProbeWithoutAPort",
     [](auto&) {
       return Arguments{testing::kItn, "probe", "localhost"};
     },
     2,
     {"\"localhost\" is not the address of a server", "HOST:PORT"}},
    {"ProbeAWebAddress",
     [](auto&) {
       return Arguments{testing::kItn, "probe", "http://localhost:50051"};
     },
     2,
     {"is not the address of a server", "HOST:PORT"}},
    {"ProbeNobody",
     [](auto&) {
       return Arguments{testing::kItn, "probe", "127.0.0.1:1"};
     },
     5,
     {"127.0.0.1:1 does not serve"}},
    {"PredictNan",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict",
                        exr_with(folder, std::numeric_limits<float>::quiet_NaN()), "--predictor",
                        "127.0.0.1:1"};
     },
     3,
     {"image.exr", "nan"}},
    {"PredictPng",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict",
                        folder.write("photo.png", "\x89PNG\r\n\x1a\n and more"), "--predictor",
                        "127.0.0.1:1"};
     },
     6,
     {"photo.png begins as a PNG image and is not a complete one"}},
    {"PredictJpeg",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict",
                        folder.write("photo.exr", "\xff\xd8\xff\xe0 and more"), "--predictor",
                        "127.0.0.1:1"};
     },
     6,
     {"photo.exr begins as a JPEG image and is not a complete one: it was cut short"}},
    {"PredictText",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict", folder.write("photo.txt", "a letter"),
                        "--predictor", "127.0.0.1:1"};
     },
     3,
     {"photo.txt is text; a photograph is an OpenEXR, PNG, JPEG, TIFF"}},
    {"PredictNoModel",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict", exr_with(folder, 1), "--model",
                        folder.write("model.itn", "not a model")};
     },
     3,
     {"model.itn is not a checkpoint"}},
    {"PredictOldModel",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict", exr_with(folder, 1), "--model",
                        folder.write("model.itn", "ITNCKPT1")};
     },
     3,
     {"model.itn was written by an earlier version", "Train the network again"}},
    {"PredictTruncatedModel",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict", exr_with(folder, 1), "--model",
                        folder.write("model.itn", "ITNCKPT2")};
     },
     6,
     {"model.itn is damaged"}},
    {"NobodyPredicts",
     [](auto& folder) {
       return Arguments{testing::kItn, "predict", exr_with(folder, 1), "--predictor",
                        "127.0.0.1:1"};
     },
     5,
     {"127.0.0.1:1"}},
    {"TrainOnNothing",
     [](auto& folder) {
       return Arguments{testing::kItn, "train", folder.path("missing"), "-o", folder.path("run")};
     },
     4,
     {"missing"}},
    {"WorkerFlag",
     [](auto&) {
       return Arguments{testing::kItnWorker, "--renders", "0"};
     },
     2,
     {"itn-worker: --renders: 0 is not a whole number in [1, 1024]"}},
    {"WorkerSeconds",
     [](auto&) {
       return Arguments{testing::kItnWorker, "--max-seconds", "nan"};
     },
     2,
     {"itn-worker: --max-seconds: nan is not a number in [0, "}},
    {"WorkerMemory",
     [](auto&) {
       return Arguments{testing::kItnWorker, "--max-memory-mb", "255"};
     },
     2,
     {"itn-worker: --max-memory-mb is 255; it must be at least 256"}},
    {"WorkerAddress",
     [](auto&) {
       return Arguments{testing::kItnWorker, "--listen", "nowhere"};
     },
     2,
     {"nowhere", "it has no port", "HOST:PORT"}},
};

void PrintTo(const BadInput& row, std::ostream* out) {
  *out << row.name;
}

class RefusedInput : public ::testing::TestWithParam<BadInput> {};

TEST_P(RefusedInput, HasAMessageAndAnExitCode) {
  const TemporaryFolder folder;
  const auto start = std::chrono::steady_clock::now();
  const testing::Finished finished = testing::run(GetParam().command(folder));
  EXPECT_EQ(finished.exit_code, GetParam().exit_code) << finished.errors;
  for (const std::string& piece : GetParam().message) {
    EXPECT_THAT(finished.errors, HasSubstr(piece));
  }
  EXPECT_EQ(finished.output, "");
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
  EXPECT_FALSE(std::filesystem::exists(folder.path("out.exr")));
}

INSTANTIATE_TEST_SUITE_P(Table, RefusedInput, ::testing::ValuesIn(kBadInputs),
                         [](const auto& row) { return row.param.name; });

}  // namespace
}  // namespace itn
