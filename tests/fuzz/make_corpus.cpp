// Writes the corpus that fuzzing begins with: make_corpus FOLDER. For each target what it accepts,
// as small as it can be with every kind of content in it. Inputs that were found are beside them,
// and stay.
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/dataset/dataset_config.h"
#include "client/dataset/plan.h"
#include "client/geometry/mesh_file.h"
#include "client/image/image.h"
#include "client/scene/text_proto.h"
#include "client/training/optimizer.h"
#include "common/files/atomic_file.h"
#include "common/geometry/shapes.h"
#include "common/learning/checkpoint.h"
#include "common/scene/wire_array.h"
#include "itn/v1/predict.pb.h"
#include "tests/bench/photograph_encoding.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/scene_files.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using testing::parse_text;

// --- Requests ---

// A boundary, a light of each kind, a surface of each shape and reflectance, transforms of each
// kind.
v1::Scene full_scene() {
  auto scene = parse_text<v1::Scene>(R"(
    object { mesh {
      normalize: true
      transforms { scale { x: 2 y: 1 z: 1 } }
      transforms { matrix { m: [1, 0, 0, 0,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1] } }
      transforms { rotate { axis { y: 1 } angle_degrees: 30 } }
      transforms { translate { x: 0.1 } } }
      rough_dielectric { index: 1.4 roughness: 0.3 single_scattering: true }
      smooth_angle_degrees: 100 }
    surfaces { rectangle { center { y: -0.1 } half_u { x: 20 } half_v { z: -20 } } reflectance: 0.3 }
    surfaces { mesh { builtin: "cube" transforms { translate { x: 3 } } } reflectance: 0.7 }
    surfaces { rectangle { center { z: 5 } half_u { x: 20 } half_v { y: 20 } }
               checkerboard { even: 0.6 odd: 0.1 corner { x: 1 } edge_u { x: 3 } edge_v { y: 2 } } }
    lights { sun_sky { turbidity: 3 ground_albedo: 0.2 sun_elevation_degrees: 40
                       sun_azimuth_degrees: 20 sun_angular_radius_degrees: 5 } }
    lights { environment_map { pixels { width: 4 height: 2 } scale: 2 rotate_y_degrees: 10 } }
    lights { constant { radiance: 0.3 } color { red: 0.5 green: 2 } }
    lights { directional { direction { x: 1 y: 2 z: -1 } irradiance: 2 } }
    lights { point { position { x: 2 y: 3 z: -1 } intensity: 1e-5 } }
    camera { origin { y: 1.5 z: -4 } target { y: 0.5 } up { y: 1 } fov_degrees: 22 }
    film { width: 6 height: 5 channel: GREEN })");
  *scene.mutable_object()->mutable_mesh()->mutable_triangles() = testing::cube();
  std::vector<float> rgb;
  for (int i = 0; i < 4 * 2 * 3; ++i) rgb.push_back(static_cast<float>(i));
  scene.mutable_lights(1)->mutable_environment_map()->mutable_pixels()->set_rgb(to_bytes(rgb));
  return scene;
}

// A smooth boundary, lamps of a size, a mesh of smooth normals, an image, a lens and a crop.
v1::Scene lamp_scene() {
  auto scene = parse_text<v1::Scene>(R"(
    object { mesh {} dielectric { index: 2.5 } medium { name: "marble" object_size: 10 } }
    surfaces { mesh { builtin: "cube" transforms { translate { x: 3 } } } smooth_angle_degrees: 100 }
    surfaces { rectangle { center { y: -0.1 } half_u { x: 20 } half_v { z: -20 } }
               image { pixels { width: 2 height: 1 } scale: 0.9 edge_u { x: 3 } edge_v { z: 2 } } }
    lights { sphere { center { x: 2 y: 2 } radius: 0.5 radiance: 4 } }
    lights { panel { center { x: -2 y: 1 } half_u { y: 1 } half_v { z: 1 } radiance: 3 } }
    lights { directional { direction { y: 1 } irradiance: 2 angular_radius_degrees: 10 } }
    camera { origin { y: 1.5 z: -4 } target { y: 0.5 } principal_x: 0.6 principal_y: 0.4
             k_1: -0.1 k_2: 0.01 crop { left: 0.1 top: 0.2 right: 0.9 bottom: 0.8 } }
    film { width: 6 height: 5 }
    other_objects { mesh { builtin: "cube" transforms { translate { x: -6 } } }
                    dielectric { index: 1.2 } smooth_angle_degrees: 40
                    material { sigma_t: 3 albedo: 0.9 g: 0.5 } })");
  *scene.mutable_object()->mutable_mesh()->mutable_triangles() = testing::cube();
  scene.mutable_surfaces(1)->mutable_image()->mutable_pixels()->set_rgb(
      to_bytes(std::vector<float>{0.1F, 0.2F, 0.3F, 1, 0.5F, 0}));
  return scene;
}

v1::Scene colours_scene() {
  v1::Scene scene = full_scene();
  scene.mutable_film()->set_channel(v1::Film::RGB);
  scene.mutable_object()->mutable_rough_dielectric()->set_roughness(0.3F);
  return scene;
}

v1::Scene places_scene() {
  v1::Scene scene = full_scene();
  scene.mutable_object()->mutable_rough_dielectric()->set_roughness(0.02F);
  *scene.mutable_surfaces(0) = parse_text<v1::Surface>(R"(
    rectangle { center { y: -0.1 } half_u { x: 20 } half_v { z: -20 } } color { red: 0.9 blue: 0 })");
  scene.mutable_lights(3)->mutable_directional()->set_angular_radius_degrees(5);
  *scene.add_lights() = parse_text<v1::Light>(
      "sphere { center { x: 2 y: 2 } radius: 0.5 radiance: 4 } color { red: 3 }");
  return scene;
}

v1::Scene spot_scene() {
  v1::Scene scene = testing::cube_scene(6, 5);
  scene.mutable_object()->mutable_rough_dielectric()->set_roughness(0.001F);
  *scene.add_lights() = parse_text<v1::Light>(
      "spot { position { y: 3 z: -2 } intensity: 1e-5 inner_angle_degrees: 10 "
      "outer_angle_degrees: 20 }");
  return scene;
}

// Normals of its own, which lean.
v1::Scene normals_scene() {
  v1::Scene scene = testing::cube_scene(6, 5);
  v1::Object& object = *scene.mutable_object();
  *object.mutable_mesh()->mutable_triangles() = testing::cube();
  const auto positions = from_bytes<Vec3f>(object.mesh().triangles().positions());
  const auto triangles = from_bytes<std::array<uint32_t, 3>>(object.mesh().triangles().indices());
  std::vector<Vec3f> normals;
  for (const auto& [a, b, c] : triangles) {
    const Vec3f own = cross(positions[b] - positions[a], positions[c] - positions[a]);
    for (int k = 0; k < 3; ++k) {
      normals.push_back(own + Vec3f{0.3F * static_cast<float>(k - 1), 0.2F, -0.1F});
    }
  }
  object.mutable_mesh()->mutable_triangles()->set_corner_normals(to_bytes(normals));
  object.mutable_rough_dielectric()->set_index(2.5F);
  scene.clear_lights();
  *scene.add_lights() = parse_text<v1::Light>("constant { radiance: 1 }");
  *scene.add_lights() =
      parse_text<v1::Light>("sphere { center { x: 2 y: 3 z: -2 } radius: 0.5 radiance: 9 }");
  return scene;
}

std::string render_request(
    const v1::Scene& scene,
    const std::function<void(v1::RenderGradRequest&)>& change = [](auto&) {}) {
  v1::RenderGradRequest request = testing::small_request(4);
  request.set_scene(scene.SerializeAsString());
  change(request);
  return request.SerializeAsString();
}

std::string loss_request() {
  const v1::Scene scene = testing::cube_scene(4, 3);
  return render_request(scene, [](v1::RenderGradRequest& request) {
    const std::vector<float> ones(4 * 3, 1.0F);
    request.set_pilot_spp(2);
    request.mutable_loss()->set_image(to_bytes(ones));
    request.mutable_loss()->set_weight(to_bytes(ones));
  });
}

v1::PredictRequest predict_request(int side, int channels) {
  v1::PredictRequest request;
  request.set_width(static_cast<uint32_t>(side));
  request.set_height(static_cast<uint32_t>(side));
  request.set_channels(static_cast<uint32_t>(channels));
  std::vector<float> pixels, mask;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const int u = 2 * x - side, v = 2 * y - side;
      mask.push_back(4 * (u * u + v * v) < side * side ? 1 : 0);
      for (int c = 0; c < channels; ++c) pixels.push_back(1 + 0.01F * static_cast<float>(x + c));
    }
  }
  request.set_image(to_bytes(pixels));
  request.set_mask(to_bytes(mask));
  return request;
}

v1::PredictRequest captured_request() {
  v1::PredictRequest request = predict_request(8, 3);
  request.set_model("gaussian");
  *request.mutable_capture() = parse_text<v1::Capture>(
      "object_size: 30 exposure: 2 clipped: 0.1 cut_by_frame: true encoded: true");
  return request;
}

v1::PredictBatchRequest batch_request() {
  v1::PredictBatchRequest batch;
  batch.set_model("gaussian");
  batch.set_one_material(true);
  *batch.add_images() = predict_request(16, 1);
  *batch.add_images() = predict_request(12, 1);
  return batch;
}

// --- Files ---

std::string obj_of(const Mesh& mesh) {
  std::string text = "o cube\nvt 0 0\nvn 0 1 0\n";
  for (const Vec3f& v : mesh.vertices) text += fmt::format("v {} {} {}\n", v.x, v.y, v.z);
  for (const auto& t : mesh.triangles) {
    text += fmt::format("f {}/1/1 {}//1 -{}\n", t[0] + 1, t[1] + 1, mesh.vertices.size() - t[2]);
  }
  return text;
}

std::string text_ply_of(const Mesh& mesh) {
  std::string text = fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
      "property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices.size(), mesh.triangles.size());
  for (const Vec3f& v : mesh.vertices) text += fmt::format("{} {} {}\n", v.x, v.y, v.z);
  for (const auto& t : mesh.triangles) text += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
  return text;
}

std::string text_stl_of(const Mesh& mesh) {
  std::string text = "solid cube\n";
  for (const auto& t : mesh.triangles) {
    text += "facet normal 0 0 0\nouter loop\n";
    for (const uint32_t i : t) {
      const Vec3f v = mesh.vertices[i];
      text += fmt::format("vertex {} {} {}\n", v.x, v.y, v.z);
    }
    text += "endloop\nendfacet\n";
  }
  return text + "endsolid cube\n";
}

std::string binary_stl_of(const Mesh& mesh) {
  std::string bytes(80, ' ');
  bytes += to_bytes(std::vector{static_cast<uint32_t>(mesh.triangles.size())});
  for (const auto& t : mesh.triangles) {
    bytes.append(12, '\0');  // the normal
    for (const uint32_t i : t) bytes += to_bytes(std::vector{mesh.vertices[i]});
    bytes.append(2, '\0');
  }
  return bytes;
}

Image small_image() {
  Image image{.width = 6, .height = 5, .channels = {}, .attributes = {{"note", "text"}, {"n", 3}}};
  for (const char* name : {"Y", "mask.Y", "clipped.Y"}) {
    for (int i = 0; i < 6 * 5; ++i) image.channels[name].push_back(static_cast<float>(i % 2));
  }
  return image;
}

std::vector<unsigned char> small_picture(int side) {
  std::vector<unsigned char> rgb;
  for (int i = 0; i < side * side * 3; ++i) rgb.push_back(static_cast<unsigned char>(i % 250));
  return rgb;
}

std::string manifest() {
  v1::DatasetConfig config = preset_config("paper");
  config.set_count(4);
  config.set_resolution(16);
  config.set_validation_fraction(0);
  const std::vector<std::string> names{"cube", "frame"};
  return to_text(plan_dataset(config, builtin_shape_set(names).shapes).manifest);
}

v1::Checkpoint of_model(const v1::Model& model) {
  v1::Checkpoint checkpoint;
  *checkpoint.mutable_model() = model;
  return checkpoint;
}

v1::Checkpoint in_training() {
  v1::Checkpoint checkpoint = of_model(small_model());
  v1::TrainingState& training = *checkpoint.mutable_training();
  training.set_step(7);
  *training.mutable_optimizer() =
      Optimizer(*load_encoder(checkpoint.model()), training.config()).state();
  *training.mutable_weights() = checkpoint.model().weights();
  return checkpoint;
}

void make_corpus(const fs::path& folder) {
  const auto path = [&](const std::string& file) {
    fs::create_directories((folder / file).parent_path());
    return folder / file;
  };
  const auto write = [&](const std::string& file, const std::string& bytes) {
    write_file_atomically(path(file), bytes);
  };
  write("render_request/cube", render_request(testing::cube_scene(4, 3)));
  write("render_request/everything", render_request(full_scene(), [](auto& request) {
          request.add_albedos(0.5);
          request.add_scene_derivatives("surface[0].reflectance");
          request.add_scene_derivatives("light[1].scale");
          request.set_pilot_spp(2);
          *request.mutable_tile() = parse_text<v1::Tile>("x: 1 y: 1 width: 3 height: 2");
        }));
  write("render_request/gradient", render_request(full_scene(), [](auto& request) {
          request.mutable_material()->clear_g();
          request.clear_derivatives();
          *request.mutable_phase() =
              parse_text<v1::PhaseFunction>("two_term { g_1: 0.7 g_2: -0.2 weight: 0.8 }");
          for (const char* name : {"sigma_s_reduced", "two_term.weight",
                                   "surface[2].checkerboard.odd", "light[4].scale"}) {
            request.add_parameters(name);
          }
          request.mutable_gradient()->set_weight(to_bytes(std::vector<float>(6 * 5, 0.5F)));
          request.mutable_gradient()->set_light(1);
        }));
  write("render_request/lamps", render_request(lamp_scene(), [](auto& request) {
          request.mutable_material()->set_albedo(1);
          request.mutable_material()->clear_g();
          request.clear_derivatives();
          *request.mutable_phase() = parse_text<v1::PhaseFunction>("von_mises_fisher { kappa: 3 }");
          for (const char* name :
               {"von_mises_fisher.kappa", "surface[1].image.scale", "light[0].scale"}) {
            request.add_parameters(name);
          }
          request.set_spp(2);
          request.set_first_sample(2);
        }));
  write("render_request/places", render_request(places_scene(), [](auto& request) {
          request.clear_derivatives();
          for (const char* name : {"light[3].directional.direction.x", "light[5].sphere.center.y",
                                   "surface[0].color.red"}) {
            request.add_parameters(name);
          }
        }));
  write("render_request/colours", render_request(colours_scene(), [](auto& request) {
          request.clear_material();
          request.clear_derivatives();
          for (const double albedo : {1.0, 0.9, 0.8}) {
            v1::Material& colour = *request.add_colours();
            colour.set_sigma_t(4 / albedo);
            colour.set_albedo(albedo);
            colour.set_g(0.2);
          }
          for (const char* name : {"sigma_a", "g", "rough_dielectric.roughness"}) {
            request.add_parameters(name);
          }
        }));
  write("render_request/spot", render_request(spot_scene(), [](auto& request) {
          request.clear_derivatives();
          request.add_parameters("rough_dielectric.roughness");
        }));
  write("render_request/normals", render_request(normals_scene(), [](auto& request) {
          request.clear_derivatives();
          request.mutable_gradient()->set_weight(to_bytes(std::vector<float>(6 * 5, -0.5F)));
          request.mutable_gradient()->set_normals(true);
        }));
  write("render_request/loss", loss_request());
  write("render_request/reference", render_request(full_scene(), [](auto& request) {
          request.set_tracer(v1::REFERENCE);
          request.set_pixels(v1::OBJECT_PIXELS);
        }));

  write("predict_request/gray", predict_request(8, 1).SerializeAsString());
  write("predict_request/captured", captured_request().SerializeAsString());
  write("predict_request/batch", batch_request().SerializeAsString());

  const Mesh cube = make_shape("cube");
  write("mesh/cube.ply", encode_ply(cube));
  write("mesh/cube_text.ply", text_ply_of(cube));
  write("mesh/cube.obj", obj_of(cube));
  write("mesh/cube.stl", binary_stl_of(cube));
  write("mesh/cube_text.stl", text_stl_of(cube));

  write_exr(path("image/small.exr"), small_image());
  const std::vector<unsigned char> rgb = small_picture(16);
  write("image/small.png", encoded(16, 16, rgb, Encoding::kPng));
  write("image/small.jpg", encoded(16, 16, rgb, Encoding::kJpeg));
  write("image/small.tif", encoded(16, 16, rgb, Encoding::kTiff));
  write("image/small.hdr", encoded(16, 16, rgb, Encoding::kHdr));
  write("image/small.webp", encoded(16, 16, rgb, Encoding::kWebp));
  const std::vector<unsigned char> gray(16 * 16 * 3, 128);
  write("image/gray.png", encoded(16, 16, gray, Encoding::kPng));
  write("image/gray.heic", encoded(16, 16, gray, Encoding::kHeic));

  write("scene_file/cube.textproto", testing::kSceneFile);
  v1::Scene files = full_scene();
  files.mutable_object()->mutable_mesh()->set_path("cube.ply");
  files.mutable_lights(1)->mutable_environment_map()->set_path("sky.exr");
  write("scene_file/files.textproto", to_text_proto(files));
  files.mutable_object()->mutable_mesh()->set_repair(true);
  write("scene_file/repaired.textproto", to_text_proto(files));

  write("manifest/cubes.textproto", manifest());

  write_checkpoint(path("checkpoint/point.itn"), of_model(small_model()));
  write_checkpoint(path("checkpoint/training.itn"), in_training());
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s FOLDER\n", argv[0]);
    return 2;
  }
  itn::make_corpus(argv[1]);
  return 0;
}
