// itn predict: optical parameters from one image.
#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <string>
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
#include "common/material.h"
#include "common/rpc/channel.h"
#include "common/rpc/status.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"
#include "itn/v1/experiment.pb.h"
#include "itn/v1/predict.grpc.pb.h"

namespace itn {
namespace {

struct PredictOptions {
  std::string image;
  std::string mask;
  std::string model;
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

std::vector<float> mask_of(const PredictOptions& options, const Image& image) {
  if (options.mask.empty()) {
    if (!image.has("mask.Y")) {
      throw invalid_input(fmt::format(
          "{} has no channel mask.Y that says where the object is; give a mask with --mask",
          options.image));
    }
    return image.channel("mask.Y");
  }
  const Image file = read_exr(options.mask);
  if (file.width != image.width || file.height != image.height) {
    throw invalid_input(fmt::format("{} is {} x {} pixels, {} is {} x {}; they must be the same",
                                    options.mask, file.width, file.height, options.image,
                                    image.width, image.height));
  }
  return file.channel(mask_channel(file, options.mask));
}

LoadedPhotograph load(const PredictOptions& options) {
  const Image image = decode_exr(read_file_or_stdin(options.image, "image"), options.image);
  const std::vector<std::string> channels = radiance_channels(image, options.image);
  const size_t count = static_cast<size_t>(image.width) * image.height;
  std::vector<float> pixels;
  pixels.reserve(count * channels.size());
  for (size_t p = 0; p < count; ++p) {
    for (const std::string& name : channels) {
      pixels.push_back(image.channels.at(name)[p]);
    }
  }
  const std::vector<float> mask = mask_of(options, image);
  const Photograph photograph{image.width, image.height, static_cast<int>(channels.size()), pixels,
                              mask};
  validate(photograph, interruption());
  return {channels, framed(photograph, interruption())};
}

v1::PredictReply ask(const PredictOptions& options, const LoadedPhotograph& photograph) {
  v1::PredictRequest request;
  request.set_width(static_cast<uint32_t>(photograph.framed.side));
  request.set_height(static_cast<uint32_t>(photograph.framed.side));
  request.set_channels(static_cast<uint32_t>(photograph.framed.channels));
  request.set_image(to_bytes(photograph.framed.pixels));
  request.set_mask(to_bytes(photograph.framed.mask));
  const auto stub = v1::PredictService::NewStub(connect_to(options.predictor));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() +
                       std::chrono::milliseconds(static_cast<int64_t>(options.timeout * 1000)));
  v1::PredictReply reply;
  const grpc::Status status = stub->Predict(&context, request, &reply);
  if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) {
    throw Error(ErrorKind::kUnavailable,
                fmt::format("{} is not a predictor; itn-predictor is one", options.predictor));
  }
  if (!status.ok()) {
    throw to_error(status, "predictor " + options.predictor);
  }
  return reply;
}

v1::Prediction prediction_of(const v1::PredictReply& reply, const LoadedPhotograph& photograph) {
  if (reply.materials_size() != static_cast<int>(photograph.channels.size())) {
    throw Error(ErrorKind::kInternal,
                fmt::format("the predictor answered {} materials for {} channels",
                            reply.materials_size(), photograph.channels.size()));
  }
  v1::Prediction prediction;
  prediction.set_model(reply.model());
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
  }
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

void print(const v1::Prediction& prediction) {
  print_result("{:7}  {:>14}  {:>7}  {:>7}  {:>14}  {:>14}\n", "channel", "sigma_t [1/mm]",
               "albedo", "g", "sigma_a [1/mm]", "sigma_s [1/mm]");
  for (const v1::Prediction::Channel& c : prediction.channels()) {
    print_result("{:7}  {:14.3f}  {:7.4f}  {:7.4f}  {:14.3f}  {:14.3f}\n", c.channel(), c.sigma_t(),
                 c.albedo(), c.g(), c.sigma_a(), c.sigma_s());
    if (c.has_posterior()) {
      print_interval(c.posterior());
    }
  }
}

void run(const PredictOptions& options, Predict* here) {
  if (options.model.empty() == options.predictor.empty()) {
    throw Error(ErrorKind::kUsage, "give either --model FILE or --predictor HOST:PORT");
  }
  if (!options.model.empty() && here == nullptr) become_learning_program();
  const LoadedPhotograph photograph = load(options);
  const v1::PredictReply reply = options.model.empty()
                                     ? ask(options, photograph)
                                     : here(options.model, photograph.framed.view());
  const v1::Prediction prediction = prediction_of(reply, photograph);
  options.json ? print_result("{}\n", to_json(prediction)) : print(prediction);
}

}  // namespace

void add_predict_command(CLI::App& app, Predict* here) {
  const auto options = std::make_shared<PredictOptions>();
  CLI::App* command = app.add_subcommand("predict", "Optical parameters of the object in an image");
  command
      ->add_option("image", options->image,
                   "EXR with channel Y, or R, G, B: linear radiance; -: standard input")
      ->required();
  command->add_option(
      "--mask", options->mask,
      "EXR that is 1 on the object (channel mask.Y, Y, L, R or A); default: the image's own "
      "channel mask.Y");
  command->add_option("--model", options->model, "Checkpoint (or run): predict in this process");
  command->add_option("--predictor", options->predictor, "HOST:PORT of an itn-predictor to ask");
  command->add_option("--timeout", options->timeout, "Of the call, in seconds")
      ->check(number_in(0.01, 3600.0))
      ->capture_default_str();
  command->add_flag("--json", options->json, "Print the result as JSON (itn.v1.Prediction)");
  command->callback([options, here] { run(*options, here); });
}

}  // namespace itn
