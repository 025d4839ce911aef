// itn._core: scenes and renders in Python's types. What is pleasant to use is made of it in
// python/itn/*.py. No gRPC, LibTorch or OpenMP.
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>
#include <pthread.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "client/exports/mitsuba_scene_file.h"
#include "client/image/image.h"
#include "client/import/import_mitsuba.h"
#include "client/json.h"
#include "client/measured_media.h"
#include "client/object_media.h"
#include "client/render/image_render.h"
#include "client/render/local_renderer.h"
#include "client/render/relay_renderer.h"
#include "client/render/render_rounds.h"
#include "client/render/reply_images.h"
#include "client/scene/scene_file.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/render_limits.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"
#include "itn/v1/dataset.pb.h"
#include "server/renderer.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace itn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

// ---- Errors ----------------------------------------------------------------------------------

// The class of itn.errors that says what kind of error it is.
const char* class_of(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kUsage:
    case ErrorKind::kInvalidInput: return "InvalidInput";
    case ErrorKind::kIo:
    case ErrorKind::kDataLoss: return "FileError";
    case ErrorKind::kLimit: return "LimitExceeded";
    case ErrorKind::kUnavailable: return "Unavailable";
    case ErrorKind::kCancelled: return "Cancelled";
    case ErrorKind::kInternal: break;
  }
  return "Error";
}

void translate(const std::exception_ptr& thrown, void* /*payload*/) {
  try {
    std::rethrow_exception(thrown);
  } catch (const Error& error) {
    const nb::object type = nb::module_::import_("itn.errors").attr(class_of(error.kind()));
    PyErr_SetString(type.ptr(), error.what());
  }
}

// What is warned of in C++, until Python takes it.
class Messages final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  static std::vector<std::string> take() {
    const std::lock_guard lock(mutex_of_all);
    return std::exchange(all, {});
  }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    constexpr size_t kMost = 100;
    const std::lock_guard lock(mutex_of_all);
    if (all.size() < kMost) all.emplace_back(message.payload.data(), message.payload.size());
  }
  void flush_() override {}

  static inline std::mutex mutex_of_all;
  static inline std::vector<std::string> all;
};

// ---- This process ----------------------------------------------------------------------------

// Set when Python ends: renders of threads that it leaves behind end before it does.
std::atomic<bool> python_ends = false;

// Renders that are under way. A process that is forked meanwhile has locks that nobody will open.
std::atomic<int> renders_under_way = 0;
std::atomic<bool> forked_under_way = false;

struct UnderWay {
  UnderWay() {
    if (python_ends) throw Error(ErrorKind::kCancelled, "Python ends");
    if (forked_under_way) {
      throw Error(ErrorKind::kInternal,
                  "this process was forked while its parent rendered; start processes by the "
                  "method 'spawn', or while nothing renders");
    }
    ++renders_under_way;
  }
  ~UnderWay() { --renders_under_way; }
  UnderWay(const UnderWay&) = delete;
  UnderWay& operator=(const UnderWay&) = delete;
};

void after_fork() {
  if (renders_under_way > 0) forked_under_way = true;
  renders_under_way = 0;
}

// Called by Python's atexit: afterwards, no thread that renders wants the interpreter's lock.
void end_renders() {
  python_ends = true;
  const nb::gil_scoped_release unlocked;
  while (renders_under_way > 0) std::this_thread::sleep_for(milliseconds(1));
}

// Of all renders of this process. It is never destroyed, as threads may use it to the end.
SceneCache& scene_cache() {
  static auto* const cache = new SceneCache(size_t{512} << 20);
  return *cache;
}

// The program itn relay, which renders by workers, behind a socket.
class Relay {
 public:
  explicit Relay(int socket)
      : socket_(socket), renderer_(std::make_unique<RelayRenderer>(socket, ITN_VERSION)) {}
  ~Relay() {
    if (getpid() != owner_ && renderer_ != nullptr) forget();
  }
  Relay(const Relay&) = delete;
  Relay& operator=(const Relay&) = delete;

  // Ends the program. What still renders by it fails.
  void close() { ::shutdown(socket_, SHUT_RDWR); }
  // In a process that was forked: that the program ends with its parent.
  void forget() {
    ::close(socket_);
    static_cast<void>(renderer_.release());  // whose threads are its parent's
  }

  JobRenderer& renderer() const { return *renderer_; }

 private:
  const pid_t owner_ = getpid();
  const int socket_;
  std::unique_ptr<RelayRenderer> renderer_;
};

// Who renders: a relay, or this process by so many threads.
class ChosenRenderer {
 public:
  ChosenRenderer(const Relay* relay, int threads) : relay_(relay) {
    if (relay == nullptr) local_.emplace(scene_cache(), threads);
  }
  JobRenderer& get() { return relay_ == nullptr ? *local_ : relay_->renderer(); }

 private:
  const Relay* const relay_;
  std::optional<LocalRenderer> local_;
};

// What ends a render from another thread.
struct Stop {
  std::atomic<bool> requested = false;
};

// ---- Scenes ----------------------------------------------------------------------------------

struct PyScene {
  v1::Scene message;
};

// (sigma_t, albedo, g) of each channel.
using Materials = std::vector<std::tuple<double, double, double>>;

void add(const Material& material, Materials& materials) {
  materials.emplace_back(material.sigma_t, material.albedo, material.g);
}

PyScene scene_of_json(const std::string& json, const std::string& folder) {
  PyScene scene;
  from_json(json, "the scene", scene.message);
  load_files(scene.message, folder);
  return scene;
}

PyScene scene_of_text(const std::string& text, const std::string& folder) {
  PyScene scene;
  parse_text_proto(text, "the scene", scene.message);
  load_files(scene.message, folder);
  return scene;
}

// The names of the fields of scenes that are bytes, and of those that are vectors.
std::pair<std::vector<std::string>, std::vector<std::string>> scene_fields() {
  std::set<std::string> bytes, vectors;
  std::set<const google::protobuf::Descriptor*> known;
  const std::function<void(const google::protobuf::Descriptor*)> look =
      [&](const google::protobuf::Descriptor* message) {
        if (!known.insert(message).second) return;
        for (int i = 0; i < message->field_count(); ++i) {
          const google::protobuf::FieldDescriptor& field = *message->field(i);
          if (field.type() == field.TYPE_BYTES) bytes.insert(field.name());
          if (field.message_type() == nullptr) continue;
          if (field.message_type() == v1::Vec3::descriptor()) vectors.insert(field.name());
          look(field.message_type());
        }
      };
  look(v1::Scene::descriptor());
  return {{bytes.begin(), bytes.end()}, {vectors.begin(), vectors.end()}};
}

struct PyImport {
  PyScene scene;      // its object has the medium, unless that has another phase function
  std::string phase;  // then
  std::vector<std::string> not_carried_over;
};

PyImport import_scene(const std::string& path, double mm_per_unit,
                      const std::vector<std::pair<std::string, std::string>>& definitions) {
  const std::filesystem::path folder = std::filesystem::absolute(path).parent_path();
  ImportOptions options;
  options.mm_per_scene_unit = mm_per_unit;
  options.output_folder = folder;
  options.definitions = {definitions.begin(), definitions.end()};
  ImportedScene imported = import_mitsuba(path, options);
  PyImport result{.scene = {std::move(imported.scene)},
                  .phase = imported.phase,
                  .not_carried_over = imported.not_carried_over};
  v1::Scene& scene = result.scene.message;
  load_files(scene, folder);
  if (imported.in_colour) scene.mutable_film()->set_channel(v1::Film::RGB);
  if (imported.medium) add_materials(*imported.medium, *scene.mutable_object());
  return result;
}

// The numbers of the scene by name, with value and range.
std::vector<std::tuple<std::string, double, double, double>> numbers_of(const PyScene& scene) {
  const SceneNumbers numbers(scene.message);
  std::vector<std::tuple<std::string, double, double, double>> found;
  const auto add = [&](const std::string& name) {
    try {
      const SceneNumber number = numbers.number(name);
      found.emplace_back(name, number.value, number.low, number.high);
    } catch (const Error&) {
      // There is none of this name in this scene.
    }
  };
  for (const std::string& pattern : derivative_names()) {
    const size_t k = pattern.find("[K]");
    if (k == std::string::npos) {
      if (!is_of_medium(pattern)) add(pattern);
      continue;
    }
    const std::string list = pattern.substr(0, k);
    const int count = list == "light"     ? scene.message.lights_size()
                      : list == "surface" ? scene.message.surfaces_size()
                                          : 0;
    for (int i = 0; i < count; ++i) {
      add(fmt::format("{}[{}]{}", list, i, pattern.substr(k + 3)));
    }
  }
  return found;
}

// ---- Images ----------------------------------------------------------------------------------

using Array = nb::ndarray<nb::numpy, float>;

// An array that owns the numbers.
Array owned(std::vector<float>&& numbers, std::initializer_list<size_t> shape) {
  auto held = std::make_unique<std::vector<float>>(std::move(numbers));
  float* const data = held->data();
  const nb::capsule owner(held.release(),
                          [](void* p) noexcept { delete static_cast<std::vector<float>*>(p); });
  return {data, shape, owner};
}

// A render that is done. Arrays are of the shape (height, width), in colour (height, width, 3).
struct PyImage {
  std::vector<ImageChannel> channels;
  std::vector<v1::RenderGradReply> replies;  // one for each channel
  v1::Counters counters;
  uint32_t spp = 0;
  bool interrupted = false;
  double seconds = 0;
  std::vector<std::string> remarks;

  size_t width() const { return replies[0].width(); }
  size_t height() const { return replies[0].height(); }
  int estimates() const { return replies[0].estimates_size(); }

  // `numbers(reply)`: of one channel.
  Array array(const auto& numbers) const {
    if (replies.size() == 1) return owned(numbers(replies[0]), {height(), width()});
    std::vector<float> all(replies.size() * width() * height());
    for (size_t c = 0; c < replies.size(); ++c) {
      const std::vector<float> one = numbers(replies[c]);
      for (size_t i = 0; i < one.size(); ++i) all[i * replies.size() + c] = one[i];
    }
    return owned(std::move(all), {height(), width(), replies.size()});
  }
};

using ImageOf = const std::string& (*)(const v1::Estimate&, int);
const std::string& radiance_of(const v1::Estimate& estimate, int /*derivative*/) {
  return estimate.radiance();
}
const std::string& derivative_of(const v1::Estimate& estimate, int derivative) {
  return estimate.derivatives(derivative);
}

// An image in grey from one estimate is in the reply as it is wanted.
Array mean(nb::handle self, ImageOf image_of, int derivative) {
  auto& image = nb::cast<PyImage&>(self);
  if (image.replies.size() == 1 && image.estimates() == 1) {
    const std::string& bytes = image_of(image.replies[0].estimates(0), derivative);
    // The reply is this object's alone.
    auto* const data = reinterpret_cast<float*>(const_cast<char*>(bytes.data()));
    return {data, {image.height(), image.width()}, self};
  }
  return image.array([&](const v1::RenderGradReply& reply) {
    return mean_of_estimates(reply, image.spp, [&](const v1::Estimate& e) -> const std::string& {
      return image_of(e, derivative);
    });
  });
}

Array one_estimate(const PyImage& image, ImageOf image_of, int derivative, int estimate) {
  return image.array([&](const v1::RenderGradReply& reply) {
    return from_bytes<float>(image_of(reply.estimates(estimate), derivative));
  });
}

// Of two estimates at least.
Array error_of_derivative(const PyImage& image, int derivative) {
  return image.array([&](const v1::RenderGradReply& reply) {
    return standard_error_of_estimates(reply, [&](const v1::Estimate& e) -> const std::string& {
      return e.derivatives(derivative);
    });
  });
}

// ---- Files -----------------------------------------------------------------------------------

using Plane = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

void write_planes(const std::string& path,
                  const std::vector<std::pair<std::string, Plane>>& planes) {
  Image image;
  image.height = static_cast<int>(planes.at(0).second.shape(0));
  image.width = static_cast<int>(planes.at(0).second.shape(1));
  for (const auto& [name, plane] : planes) {
    require(
        plane.shape(0) == planes[0].second.shape(0) && plane.shape(1) == planes[0].second.shape(1),
        "planes: they are not of one size");
    image.channels[name] = {plane.data(), plane.data() + plane.size()};
  }
  check_finite(image, path);
  write_exr(path, image);
}

std::vector<std::pair<std::string, Array>> read_planes(const std::string& path) {
  Image image = read_exr(path);
  std::vector<std::pair<std::string, Array>> planes;
  for (auto& [name, numbers] : image.channels) {
    planes.emplace_back(name, owned(std::move(numbers), {static_cast<size_t>(image.height),
                                                         static_cast<size_t>(image.width)}));
  }
  return planes;
}

// Of each item of a dataset: its file, split, shape, and the materials of its channels.
using Item = std::tuple<std::string, std::string, std::string, Materials>;
std::vector<Item> read_manifest(const std::string& path) {
  v1::Dataset dataset;
  parse_text_proto(read_file(path, "dataset's manifest"), path, dataset);
  std::vector<Item> items;
  for (const v1::DatasetItem& item : dataset.items()) {
    Materials materials;
    for (const v1::Material& m : item.colours()) add(from_proto(m), materials);
    if (item.colours().empty()) add(from_proto(item.material()), materials);
    const std::string split = item.split() == v1::SPLIT_TEST         ? "test"
                              : item.split() == v1::SPLIT_VALIDATION ? "validation"
                                                                     : "train";
    items.emplace_back(item.file(), split, item.shape(), materials);
  }
  return items;
}

nb::bytes png_of(const nb::ndarray<const unsigned char, nb::shape<-1, -1, 3>, nb::c_contig,
                                   nb::device::cpu>& pixels) {
  const std::string file =
      encode_png(static_cast<int>(pixels.shape(1)), static_cast<int>(pixels.shape(0)),
                 std::span(pixels.data(), pixels.size()));
  return nb::bytes(file.data(), file.size());
}

// ---- Renders ---------------------------------------------------------------------------------

struct PyRequest {
  ImageRequest image;
  double noise = 0, seconds = 0;
  int threads = 0;
};

void set_phase(PyRequest& request, const std::string& text) {
  request.image.phase.reset();
  if (!text.empty()) parse_text_proto(text, "phase", request.image.phase.emplace());
}

// Called every 10 ms without the interpreter's lock.
class Watch {
 public:
  Watch(Stop* stop, nb::object progress) : stop_(stop), progress_(std::move(progress)) {}

  void look(double fraction) const {
    if (python_ends) throw Error(ErrorKind::kCancelled, "Python ends");
    if (stop_ != nullptr && stop_->requested) throw Error(ErrorKind::kCancelled, "cancelled");
    const nb::gil_scoped_acquire lock;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (!progress_.is_none()) progress_(fraction);
  }

 private:
  Stop* const stop_;
  const nb::object progress_;
};

PyImage render(const PyScene& scene, const PyRequest& request, const Relay* relay, Stop* stop,
               nb::object progress) {
  const UnderWay under_way;
  const auto start = steady_clock::now();
  const Watch watch(stop, std::move(progress));
  const nb::gil_scoped_release unlocked;
  PyImage image;
  image.channels = channels_of(request.image, scene.message);
  const std::vector<RenderJob> jobs = jobs_of(request.image, scene.message, image.channels);
  const RenderGoal goal{.noise = request.noise,
                        .seconds = request.seconds,
                        .spp = request.image.spp,
                        .estimates = request.image.estimates};
  ChosenRenderer renderer(relay, request.threads);
  RoundsReply done = render_rounds(
      renderer.get(), jobs, goal, start,
      [&](const RenderedSoFar& so_far, uint32_t round, double fraction) {
        watch.look((so_far.spp + fraction * round) / static_cast<double>(so_far.spp + round));
      });
  image.counters = sum_of_counters(done.replies);
  image.replies = replies_of(image.channels, std::move(done.replies));
  image.spp = done.spp;
  image.interrupted = done.interrupted;
  image.remarks = remarks_on(image.channels, image.replies, image.counters, goal, image.spp);
  image.seconds = std::chrono::duration<double>(steady_clock::now() - start).count();
  return image;
}

// The materials of the channels of an image.
Materials materials_of(const std::vector<ImageChannel>& channels) {
  Materials materials;
  for (const ImageChannel& channel : channels) add(channel.material, materials);
  return materials;
}

// The gradient of the weighted sum of the pixels, in the request's derivatives, for each channel of
// the image, of which there are as many `weights`.
std::vector<std::vector<double>> gradient(const PyScene& scene, const PyRequest& request,
                                          const Relay* relay, const std::vector<Plane>& weights,
                                          Stop* stop, nb::object progress) {
  const UnderWay under_way;
  const Watch watch(stop, std::move(progress));
  const nb::gil_scoped_release unlocked;
  const std::vector<ImageChannel> channels = channels_of(request.image, scene.message);
  require(weights.size() == channels.size(),
          fmt::format("weights: they are of {} channels, the image has {}", weights.size(),
                      channels.size()));
  const v1::Film& film = scene.message.film();
  std::vector<std::vector<double>> gradients(channels.size());
  std::vector<RenderJob> jobs;
  std::vector<size_t> channel_of_job;
  for (size_t c = 0; c < channels.size(); ++c) {
    const Plane& plane = weights[c];
    require(plane.shape(0) == film.height() && plane.shape(1) == film.width(),
            fmt::format("weights: they are {} x {}, the film is {} x {} (height x width)",
                        plane.shape(0), plane.shape(1), film.height(), film.width()));
    const std::span numbers(plane.data(), plane.size());
    gradients[c].resize(request.image.derivatives.size());
    if (std::ranges::all_of(numbers, [](float w) { return w == 0; })) continue;
    RenderJob& job = jobs.emplace_back(
        jobs_of(request.image, scene.message, std::span(&channels[c], 1)).front());
    job.request.mutable_gradient()->set_weight(to_bytes(numbers));
    channel_of_job.push_back(c);
  }
  ChosenRenderer renderer(relay, request.threads);
  const std::vector<v1::RenderGradReply> replies =
      renderer.get().render_split(jobs, [&](double fraction) { watch.look(fraction); });
  for (size_t i = 0; i < replies.size(); ++i) {
    const auto& numbers = replies[i].estimates(0).gradient();
    gradients[channel_of_job[i]].assign(numbers.begin(), numbers.end());
  }
  return gradients;
}

}  // namespace

NB_MODULE(_core, module) {
  nb::register_exception_translator(translate);
  pthread_atfork(nullptr, nullptr, after_fork);
  nb::set_leak_warnings(false);  // what PyTorch holds to the end is no leak of ours
  const auto logger = std::make_shared<spdlog::logger>("itn", std::make_shared<Messages>());
  logger->set_level(spdlog::level::warn);
  spdlog::set_default_logger(logger);
  module.attr("VERSION") = ITN_VERSION;
  module.def("end_renders", end_renders);
  module.def("scene_fields", scene_fields);
  module.def("take_messages", Messages::take);
  module.attr("MAX_ESTIMATES") = kMaxEstimates;
  module.attr("MAX_PILOT_SPP") = kMaxPilotSpp;

  nb::class_<Stop>(module, "Stop")
      .def(nb::init<>())
      .def("request", [](Stop& stop) { stop.requested = true; })
      .def_prop_ro("requested", [](const Stop& stop) { return stop.requested.load(); });

  nb::class_<Relay>(module, "Relay")
      .def(nb::init<int>(), "socket"_a)
      .def("close", &Relay::close)
      .def("forget", &Relay::forget);

  nb::class_<PyScene>(module, "Scene")
      .def_static("load", [](const std::string& path) { return PyScene{load_scene(path)}; })
      .def_static("of_text", scene_of_text)
      .def_static("of_json", scene_of_json)
      .def("to_text", [](const PyScene& scene) { return to_text_proto(scene.message); })
      .def("to_json", [](const PyScene& scene) { return to_json(scene.message); })
      .def("check", [](const PyScene& scene) { check_scene(scene.message); })
      .def("numbers", numbers_of)
      .def("width", [](const PyScene& scene) { return scene.message.film().width(); })
      .def("height", [](const PyScene& scene) { return scene.message.film().height(); })
      .def(
          "coloured",
          [](const PyScene& scene, bool colour) {
            PyScene other = scene;
            other.message.mutable_film()->set_channel(colour ? v1::Film::RGB : v1::Film::LUMINANCE);
            return other;
          })
      .def("is_in_colour",
           [](const PyScene& scene) { return scene.message.film().channel() == v1::Film::RGB; })
      .def("resized", [](const PyScene& scene, uint32_t width, uint32_t height) {
        PyScene other = scene;
        other.message.mutable_film()->set_width(width);
        other.message.mutable_film()->set_height(height);
        return other;
      });

  nb::class_<PyImport>(module, "Import")
      .def_ro("scene", &PyImport::scene)
      .def_ro("phase", &PyImport::phase)
      .def_ro("not_carried_over", &PyImport::not_carried_over);
  module.def("import_mitsuba", import_scene);

  module.def("derivative_names", derivative_names);
  module.def("is_of_medium", is_of_medium);
  module.attr("MAX_SPP") = kMaxSamples;
  module.def("measured_media", [] {
    std::vector<std::tuple<std::string, std::string, double, Materials>> media;
    for (const MeasuredMedium& medium : measured_media()) {
      Materials channels;
      for (size_t c = 0; c < 3; ++c) add(medium.material(c), channels);
      media.emplace_back(medium.name, medium.source, medium.index, channels);
    }
    return media;
  });

  nb::class_<PyRequest>(module, "Request")
      .def(nb::init<>())
      .def("set_medium",
           [](PyRequest& r, const std::string& name, double object_size) {
             r.image.medium = name;
             r.image.object_size = object_size;
           })
      .def("take_medium",
           [](PyRequest& r, const PyScene& scene) { return take_medium(scene.message, r.image); })
      .def("set_material",
           [](PyRequest& r, std::vector<double> sigma_t, std::vector<double> albedo,
              std::vector<double> g) {
             r.image.sigma_t = std::move(sigma_t);
             r.image.albedo = std::move(albedo);
             r.image.g = std::move(g);
           })
      .def("set_phase", set_phase)
      .def("set_pixels",
           [](PyRequest& r, const std::string& word) { r.image.pixels = pixels_named(word); })
      .def("set_tracer",
           [](PyRequest& r, const std::string& word) { r.image.tracer = tracer_named(word); })
      .def("set_colour", [](PyRequest& r, bool colour) { r.image.colour = colour; })
      .def("set_samples",
           [](PyRequest& r, uint32_t spp, uint64_t seed, uint32_t estimates, uint32_t pilot_spp) {
             r.image.spp = spp;
             r.image.seed = seed;
             r.image.estimates = estimates;
             r.image.pilot_spp = pilot_spp;
           })
      .def("set_goal",
           [](PyRequest& r, double noise, double seconds) {
             r.noise = noise;
             r.seconds = seconds;
           })
      .def("set_derivatives",
           [](PyRequest& r, std::vector<std::string> names) {
             r.image.derivatives = std::move(names);
           })
      .def("set_values",
           [](PyRequest& r, const std::vector<std::pair<std::string, double>>& values) {
             r.image.values.clear();
             for (const auto& [name, value] : values) r.image.values.push_back({name, value});
           })
      .def("set_threads", [](PyRequest& r, int threads) { r.threads = threads; });

  nb::class_<PyImage>(module, "Image")
      .def_prop_ro("spp", [](const PyImage& image) { return image.spp; })
      .def_prop_ro("interrupted", [](const PyImage& image) { return image.interrupted; })
      .def_prop_ro("seconds", [](const PyImage& image) { return image.seconds; })
      .def_prop_ro("remarks", [](const PyImage& image) { return image.remarks; })
      .def_prop_ro("estimates", &PyImage::estimates)
      .def_prop_ro("counters",
                   [](const PyImage& image) {
                     const v1::Counters& c = image.counters;
                     return std::tuple(c.paths(), c.steps(), c.invalid_samples(), c.leaks(),
                                       c.cpu_seconds());
                   })
      .def_prop_ro("materials", [](const PyImage& image) { return materials_of(image.channels); })
      .def("radiance", [](nb::handle self) { return mean(self, radiance_of, 0); })
      .def("radiance_of_estimate",
           [](const PyImage& image, int k) { return one_estimate(image, radiance_of, 0, k); })
      .def("standard_error",
           [](const PyImage& image) {
             return image.array([](const v1::RenderGradReply& reply) {
               return from_bytes<float>(reply.standard_error());
             });
           })
      .def("mask",
           [](const PyImage& image) {
             return owned(from_bytes<float>(image.replies[0].mask()),
                          {image.height(), image.width()});
           })
      .def("derivative", [](nb::handle self, int d) { return mean(self, derivative_of, d); })
      .def("derivative_of_estimate", [](const PyImage& image, int d,
                                        int k) { return one_estimate(image, derivative_of, d, k); })
      .def("derivative_error", error_of_derivative);

  module.def("write_mitsuba_scene",
             [](const std::string& path, const PyScene& scene, const PyRequest& request) {
               return write_mitsuba_scene(path, scene.message, request.image);
             });
  module.def("write_exr", write_planes);
  module.def("read_exr", read_planes);
  module.def("encode_png", png_of);
  module.def("noise_on_object", [](const Plane& radiance, const Plane& error, const Plane& mask) {
    const auto numbers = [](const Plane& plane) {
      return std::vector<float>(plane.data(), plane.data() + plane.size());
    };
    return noise_on_object(numbers(radiance), numbers(error), numbers(mask));
  });
  module.def("read_manifest", read_manifest);

  module.def("render", render, "scene"_a, "request"_a, "relay"_a.none(), "stop"_a.none(),
             "progress"_a.none());
  module.def("materials_of", [](const PyScene& scene, const PyRequest& request) {
    return materials_of(channels_of(request.image, scene.message));
  });
  module.def("gradient", gradient, "scene"_a, "request"_a, "relay"_a.none(), "weights"_a,
             "stop"_a.none(), "progress"_a.none());
}

}  // namespace itn
