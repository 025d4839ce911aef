// itn predict: optical parameters from images.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/command.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/learning_program.h"
#include "client/output.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/flags.h"
#include "common/image/channels.h"
#include "common/image/image.h"
#include "common/image/photograph.h"
#include "common/learning/model_files.h"
#include "common/material.h"
#include "common/rpc/channel.h"
#include "common/rpc/status.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"
#include "itn/v1/experiment.pb.h"
#include "itn/v1/predict.grpc.pb.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

struct PredictOptions {
  std::vector<std::string> images;  // files and folders
  std::string mask;
  std::optional<std::string> model;
  std::string predictor;
  double timeout = 60;  // in seconds
  bool json = false;
};

// What the network sees of an image, and the names of its channels. It is framed here, so that an
// image of any size can be sent; the predictor would do just the same.
struct LoadedPhotograph {
  std::vector<std::string> channels;
  FramedPhotograph framed;
};

// --- What is asked ---

constexpr const char* kImageExtension = ".exr";

// Those that the arguments name; of a folder its EXR files, by name.
std::vector<std::string> image_files(const std::vector<std::string>& arguments) {
  std::vector<std::string> files;
  for (const std::string& argument : arguments) {
    if (!fs::is_directory(argument)) {
      files.push_back(argument);
      continue;
    }
    std::vector<std::string> inside;
    for (const fs::directory_entry& entry : fs::directory_iterator(argument)) {
      if (entry.path().extension() == kImageExtension) inside.push_back(entry.path().string());
    }
    if (inside.empty()) {
      throw Error(ErrorKind::kIo,
                  fmt::format("there is no {} file in {}", kImageExtension, argument));
    }
    std::ranges::sort(inside);
    files.insert(files.end(), inside.begin(), inside.end());
  }
  return files;
}

// The file with the mask of an image; empty if that has it itself.
std::string mask_file(const PredictOptions& options, const std::string& image) {
  if (options.mask.empty() || !fs::is_directory(options.mask)) return options.mask;
  return (fs::path(options.mask) / fs::path(image).filename()).string();
}

std::vector<float> mask_of(const Image& image, const std::string& name, const std::string& mask) {
  if (mask.empty()) {
    if (!image.has("mask.Y")) {
      throw invalid_input(fmt::format(
          "{} has no channel mask.Y that says where the object is; give a mask with --mask", name));
    }
    return image.channel("mask.Y");
  }
  const Image file = read_exr(mask);
  if (file.width != image.width || file.height != image.height) {
    throw invalid_input(fmt::format("{} is {} x {} pixels, {} is {} x {}; they must be the same",
                                    mask, file.width, file.height, name, image.width,
                                    image.height));
  }
  return file.channel(mask_channel(file, mask));
}

LoadedPhotograph load(const PredictOptions& options, const std::string& file) {
  const Image image = decode_exr(read_file_or_stdin(file, "image"), file);
  const std::vector<std::string> channels = radiance_channels(image, file);
  const size_t count = static_cast<size_t>(image.width) * image.height;
  std::vector<float> pixels;
  pixels.reserve(count * channels.size());
  for (size_t p = 0; p < count; ++p) {
    for (const std::string& name : channels) {
      pixels.push_back(image.channels.at(name)[p]);
    }
  }
  const std::vector<float> mask = mask_of(image, file, mask_file(options, file));
  const Photograph photograph{image.width, image.height, static_cast<int>(channels.size()), pixels,
                              mask};
  validate(photograph, interruption());
  return {channels, framed(photograph, interruption())};
}

// --- Who is asked ---

v1::PredictRequest request_of(const FramedPhotograph& photograph) {
  v1::PredictRequest request;
  request.set_width(static_cast<uint32_t>(photograph.side));
  request.set_height(static_cast<uint32_t>(photograph.side));
  request.set_channels(static_cast<uint32_t>(photograph.channels));
  request.set_image(to_bytes(photograph.pixels));
  request.set_mask(to_bytes(photograph.mask));
  return request;
}

// A predictor over RPC.
class RemotePredictor {
 public:
  RemotePredictor(const std::string& address, double timeout)
      : address_(address),
        timeout_(static_cast<int64_t>(timeout * 1000)),
        stub_(v1::PredictService::NewStub(connect_to(address))) {}

  v1::PredictBatchReply operator()(std::span<const FramedPhotograph> photographs) const {
    v1::PredictBatchReply reply;
    if (photographs.size() == 1) {
      require_ok(call(&v1::PredictService::Stub::Predict, request_of(photographs.front()),
                      *reply.add_outcomes()->mutable_reply()));
      return reply;
    }
    v1::PredictBatchRequest request;
    for (const FramedPhotograph& photograph : photographs) {
      *request.add_images() = request_of(photograph);
    }
    const grpc::Status status = call(&v1::PredictService::Stub::PredictBatch, request, reply);
    if (status.error_code() != grpc::StatusCode::RESOURCE_EXHAUSTED) {
      require_ok(status);
      return reply;
    }
    // More than it takes at a time.
    const size_t half = photographs.size() / 2;
    reply = (*this)(photographs.first(half));
    reply.MergeFrom((*this)(photographs.subspan(half)));
    return reply;
  }

 private:
  template <typename Method, typename Request, typename Reply>
  grpc::Status call(Method method, const Request& request, Reply& reply) const {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + timeout_);
    return ((*stub_).*method)(&context, request, &reply);
  }

  void require_ok(const grpc::Status& status) const {
    if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) {
      throw Error(ErrorKind::kUnavailable,
                  fmt::format("{} is not a predictor; itn-predictor is one", address_));
    }
    if (!status.ok()) throw to_error(status, "predictor " + address_);
  }

  std::string address_;
  std::chrono::milliseconds timeout_;
  std::shared_ptr<v1::PredictService::Stub> stub_;
};

// --- What is answered ---

v1::Prediction prediction_of(const std::string& image, const v1::PredictReply& reply,
                             const LoadedPhotograph& photograph) {
  if (reply.materials_size() != static_cast<int>(photograph.channels.size())) {
    throw Error(ErrorKind::kInternal,
                fmt::format("the predictor answered {} materials for {} channels",
                            reply.materials_size(), photograph.channels.size()));
  }
  v1::Prediction prediction;
  prediction.set_image(image);
  prediction.set_model(reply.model());
  *prediction.mutable_model_version() = reply.model_version();
  for (int i = 0; i < reply.materials_size(); ++i) {
    const Material material = from_proto(reply.materials(i));
    v1::Prediction::Channel& channel = *prediction.add_channels();
    channel.set_channel(photograph.channels[static_cast<size_t>(i)]);
    channel.set_sigma_t(material.sigma_t);
    channel.set_albedo(material.albedo);
    channel.set_g(material.g);
    channel.set_sigma_a(material.sigma_a());
    channel.set_sigma_s(material.sigma_s());
    if (reply.posteriors_size() == reply.materials_size()) {
      const v1::MaterialPosterior& posterior = reply.posteriors(i);
      channel.set_sigma_a(posterior.sigma_a().mean());
      channel.set_sigma_s(posterior.sigma_s().mean());
      *channel.mutable_posterior() = posterior;
    }
    if (reply.caveats_size() == reply.materials_size()) {
      *channel.mutable_caveats() = reply.caveats(i);
    }
  }
  return prediction;
}

v1::Prediction failure_of(const std::string& image, const std::string& what) {
  v1::Prediction prediction;
  prediction.set_image(image);
  prediction.set_error(what);
  return prediction;
}

// The ends of the 90 % intervals under the best guesses, and how the parameters hang together.
void print_interval(const v1::MaterialPosterior& p) {
  const auto print_end = [&](const char* name, double (v1::ParameterPosterior::*end)() const) {
    print_result("{:>7}  {:14.3f}  {:7.4f}  {:7.4f}  {:14.3f}  {:14.3f}\n", name,
                 (p.sigma_t().*end)(), (p.albedo().*end)(), (p.g().*end)(), (p.sigma_a().*end)(),
                 (p.sigma_s().*end)());
  };
  print_end("5 %", &v1::ParameterPosterior::low);
  print_end("95 %", &v1::ParameterPosterior::high);
  if (p.correlations_size() == 3) {
    print_result(
        "         correlations: sigma_t and albedo {:+.2f}, sigma_t and g {:+.2f}, albedo and "
        "g {:+.2f}\n",
        p.correlations(0), p.correlations(1), p.correlations(2));
  }
}

std::string in_words(v1::MaterialBound bound) {
  switch (bound) {
    case v1::SIGMA_T_LEAST: return "the least sigma_t";
    case v1::SIGMA_T_MOST: return "the greatest sigma_t";
    case v1::ALBEDO_LEAST: return "the least albedo";
    case v1::ALBEDO_MOST: return "the greatest albedo";
    case v1::G_LEAST: return "the least g";
    case v1::G_MOST: return "the greatest g";
    default: return "an end";
  }
}

void print_caveats(const v1::Caveats& caveats) {
  if (caveats.at_bounds_size() > 0) {
    std::vector<std::string> ends;
    for (const int bound : caveats.at_bounds()) {
      ends.push_back(in_words(static_cast<v1::MaterialBound>(bound)));
    }
    print_result("         at the bound of what the model was trained for: {}\n",
                 fmt::join(ends, ", "));
  }
  const v1::Unfamiliarity& unfamiliarity = caveats.unfamiliarity();
  if (unfamiliarity.unfamiliar()) {
    print_result(
        "         UNFAMILIAR, {:.1f} times as far from the images of training as 99 % of such "
        "images: do not trust this answer ({})\n",
        unfamiliarity.score(), unfamiliarity.reason());
  }
}

// Predictions as they come, as a table or as JSON.
class Printer {
 public:
  // Of several images each is named.
  Printer(bool json, bool several) : json_(json), several_(several) {}

  void print(const v1::Prediction& prediction) {
    if (json_) {
      print_result("{}\n", to_json(prediction));
      return;
    }
    if (!begun_) {
      print_result("{:7}  {:>14}  {:>7}  {:>7}  {:>14}  {:>14}\n", "channel", "sigma_t [1/mm]",
                   "albedo", "g", "sigma_a [1/mm]", "sigma_s [1/mm]");
      begun_ = true;
    }
    if (several_) print_result("{}\n", prediction.image());
    if (!prediction.error().empty()) print_result("         {}\n", prediction.error());
    for (const v1::Prediction::Channel& c : prediction.channels()) print(c);
    if (prediction.channels_size() > 0) last_ = prediction;
  }

  // Who it was that answered.
  void finish() const {
    if (json_ || last_.channels_size() == 0) return;
    constexpr size_t kShortDigest = 12;
    const v1::ModelVersion& model = last_.model_version();
    print_result(
        "model: {}{}{}{}\n", last_.model(), model.version().empty() ? " (without a version)" : "",
        model.sha256().empty() ? "" : ", weights ", model.sha256().substr(0, kShortDigest));
    if (!last_.channels(0).caveats().has_unfamiliarity()) {
      print_result(
          "It does not know the images of its training: whether it was trained for images like "
          "{} is not said.\n",
          several_ ? "these" : "this");
    }
  }

 private:
  static void print(const v1::Prediction::Channel& c) {
    print_result("{:7}  {:14.3f}  {:7.4f}  {:7.4f}  {:14.3f}  {:14.3f}\n", c.channel(), c.sigma_t(),
                 c.albedo(), c.g(), c.sigma_a(), c.sigma_s());
    if (c.has_posterior()) print_interval(c.posterior());
    print_caveats(c.caveats());
  }

  bool json_, several_;
  bool begun_ = false;
  v1::Prediction last_;  // that has an answer
};

// --- All of it ---

// An image that could not be used does not keep others from being answered, unless it is alone.
class Failures {
 public:
  void add(ErrorKind kind) {
    if (count_++ == 0) first_ = kind;
  }
  void throw_if_any(size_t images) const {
    if (count_ > 0) {
      throw Error(first_, fmt::format("{} of {} images could not be used", count_, images));
    }
  }

 private:
  size_t count_ = 0;
  ErrorKind first_ = ErrorKind::kInvalidInput;
};

// Images that are asked for together: no more than any predictor takes.
constexpr size_t kImagesAtATime = 64;
constexpr uint64_t kPixelsAtATime = uint64_t{1} << 20;

// The next images, loaded, and what is wrong with those that could not be.
struct Group {
  std::vector<std::string> files;
  std::vector<std::optional<Error>> errors;  // by file
  std::vector<LoadedPhotograph> loaded;      // without those

  std::vector<FramedPhotograph> framed() {
    std::vector<FramedPhotograph> result;
    for (LoadedPhotograph& photograph : loaded) result.push_back(std::move(photograph.framed));
    return result;
  }
};

Group load_group(const PredictOptions& options, std::span<const std::string> files, bool alone) {
  Group group;
  uint64_t pixels = 0;
  for (const std::string& file : files) {
    if (group.files.size() == kImagesAtATime || pixels >= kPixelsAtATime) break;
    throw_if_interrupted();
    group.files.push_back(file);
    group.errors.emplace_back();
    try {
      group.loaded.push_back(load(options, file));
      pixels += uint64_t{1} * group.loaded.back().framed.side * group.loaded.back().framed.side;
    } catch (const Error& error) {
      if (alone || error.kind() == ErrorKind::kCancelled) throw;
      group.errors.back() = error;
    }
  }
  return group;
}

void run(const PredictOptions& options, LoadPredictor* here) {
  if (options.model && !options.predictor.empty()) {
    throw Error(ErrorKind::kUsage, "give either --model or --predictor HOST:PORT");
  }
  const std::vector<std::string> files = image_files(options.images);
  const bool several = files.size() > 1;
  if (several && !options.mask.empty() && !fs::is_directory(options.mask)) {
    throw Error(
        ErrorKind::kUsage,
        "--mask must be a folder for several images, with a mask of the same name for each");
  }
  Predict predict;
  if (!options.predictor.empty()) {
    predict = RemotePredictor(options.predictor, options.timeout);
  } else {
    const fs::path model = find_model(options.model.value_or(""));
    if (here == nullptr) become_learning_program();
    predict = here(model);
  }
  Printer printer(options.json, several);
  Failures failures;
  for (size_t done = 0; done < files.size();) {
    Group group = load_group(options, std::span(files).subspan(done), !several);
    done += group.files.size();
    const std::vector<FramedPhotograph> framed = group.framed();
    const v1::PredictBatchReply reply = framed.empty() ? v1::PredictBatchReply() : predict(framed);
    if (reply.outcomes_size() != static_cast<int>(framed.size())) {
      throw Error(ErrorKind::kInternal, fmt::format("the predictor answered {} of {} images",
                                                    reply.outcomes_size(), framed.size()));
    }
    int next = 0;
    for (size_t i = 0; i < group.files.size(); ++i) {
      std::optional<Error> error = group.errors[i];
      if (!error) {
        const v1::PredictOutcome& outcome = reply.outcomes(next);
        const LoadedPhotograph& photograph = group.loaded[static_cast<size_t>(next++)];
        if (outcome.code() == grpc::StatusCode::OK) {
          printer.print(prediction_of(group.files[i], outcome.reply(), photograph));
          continue;
        }
        error = to_error({static_cast<grpc::StatusCode>(outcome.code()), outcome.message()}, "");
        if (!several) throw *error;
      }
      printer.print(failure_of(group.files[i], error->what()));
      failures.add(error->kind());
    }
  }
  printer.finish();
  failures.throw_if_any(files.size());
}

}  // namespace

void add_predict_command(CLI::App& app, LoadPredictor* here) {
  const auto options = std::make_shared<PredictOptions>();
  CLI::App* command =
      app.add_subcommand("predict", "Optical parameters of the object in an image, or in many");
  command
      ->add_option(
          "image", options->images,
          "EXR with channel Y, or R, G, B: linear radiance; -: standard input. Several, or "
          "a folder of them: one that cannot be used loses none of the others")
      ->required();
  command->add_option(
      "--mask", options->mask,
      "EXR that is 1 on the object (channel mask.Y, Y, L, R or A), or a folder with one of the "
      "same name for each image; default: the image's own channel mask.Y");
  command->add_option("--model", options->model,
                      fmt::format("Predict in this process, by a model that itn models lists, a "
                                  "checkpoint or the folder of a run; default: {}",
                                  kDefaultModel));
  command->add_option("--predictor", options->predictor, "HOST:PORT of an itn-predictor to ask");
  command->add_option("--timeout", options->timeout, "Of a call, in seconds")
      ->check(number_in(0.01, 3600.0))
      ->capture_default_str();
  command->add_flag("--json", options->json,
                    "Print the result as JSON (itn.v1.Prediction), of several images one a line");
  command->callback([options, here] { run(*options, here); });
}

}  // namespace itn
