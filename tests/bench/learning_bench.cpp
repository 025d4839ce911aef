// learning_bench: how many images a second networks are trained with and predict, by architecture
// and width. On a machine that does other things too, CPU time tells more than the clock.
#include <fmt/format.h>

#include <torch/optim/adam.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <functional>
#include <string>
#include <vector>

#include "common/learning/encoder.h"
#include "common/learning/gaussian.h"
#include "common/learning/network_input.h"
#include "tests/support/cpu_time.h"

namespace itn {
namespace {

struct Options {
  std::vector<std::string> architectures{"residual", "paper"};
  std::vector<uint32_t> base_channels{16, 24, 32};
  std::vector<uint32_t> blocks{1};
  uint32_t resolution = 64;
  int64_t batch = 32;
  int threads = 2;
  double seconds = 4;
};

v1::Model model_of(const std::string& architecture, uint32_t base, uint32_t blocks,
                   uint32_t resolution) {
  v1::Model model;
  model.set_resolution(resolution);
  model.set_image_scale(1);
  if (architecture == "paper") {
    model.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(base);
    model.set_output(v1::POINT);
    model.set_input(v1::LUMINANCE_AND_WEIGHT);
  } else {
    auto& residual = *model.mutable_architecture()->mutable_residual_convolutions();
    residual.set_base_channels(base);
    residual.set_blocks(blocks);
    model.set_output(v1::GAUSSIAN);
    model.set_input(v1::RATIOS);
  }
  return model;
}

// Discs with a pattern.
ImageBatch images_of(int64_t count, int64_t resolution) {
  const torch::Tensor at =
      (torch::arange(resolution) + 0.5) / static_cast<double>(resolution) - 0.5;
  const torch::Tensor inside = (at.square().unsqueeze(1) + at.square() < 0.11).to(torch::kFloat32);
  ImageBatch images;
  images.mask = inside.expand({count, resolution, resolution}).contiguous();
  images.luminance = images.mask * (0.5 + torch::rand({count, resolution, resolution}));
  images.weight = images.mask;
  return images;
}

struct Speed {
  double per_second, cpu_seconds_per_1000;
};

Speed measure(const Options& options, const std::function<void()>& batch) {
  using Clock = std::chrono::steady_clock;
  batch();
  const double cpu = testing::own_cpu_seconds();
  const auto start = Clock::now();
  double images = 0, elapsed = 0;
  while (elapsed < options.seconds) {
    batch();
    images += static_cast<double>(options.batch);
    elapsed = std::chrono::duration<double>(Clock::now() - start).count();
  }
  return {images / elapsed, 1000 * (testing::own_cpu_seconds() - cpu) / images};
}

void bench(const Options& options, const std::string& architecture, uint32_t base,
           uint32_t blocks) {
  const v1::Model model = model_of(architecture, base, blocks, options.resolution);
  const Encoder encoder = new_encoder(model);
  torch::optim::Adam optimizer(encoder->parameters(), torch::optim::AdamOptions(1e-3));
  const ImageBatch images = images_of(options.batch, options.resolution);
  const torch::Tensor targets = torch::randn({options.batch, 3});
  encoder->train();
  const Speed training = measure(options, [&] {
    const torch::Tensor outputs = encoder->forward(network_input(model, images));
    const torch::Tensor loss = model.output() == v1::GAUSSIAN
                                   ? negative_log_likelihood(outputs, targets).mean()
                                   : (outputs - targets).square().sum(1).mean();
    optimizer.zero_grad();
    loss.backward();
    optimizer.step();
  });
  encoder->eval();
  const torch::NoGradGuard no_gradient;
  const Speed prediction =
      measure(options, [&] { encoder->forward(network_input(model, images)); });
  int64_t weights = 0;
  for (const NamedTensor& named : all_tensors(*encoder)) weights += named.tensor.numel();
  fmt::print("{:12} {:5} {:6} {:11.2f}  {:12.0f} {:8.2f}  {:12.0f} {:8.2f}\n", architecture, base,
             blocks, static_cast<double>(weights) / 1e6, training.per_second,
             training.cpu_seconds_per_1000, prediction.per_second, prediction.cpu_seconds_per_1000);
  std::fflush(stdout);
}

int run(int argc, char** argv) {
  Options options;
  CLI::App app("Training and prediction speed of encoder networks");
  app.add_option("--architecture", options.architectures, "residual, paper")
      ->delimiter(',')
      ->check(CLI::IsMember({"residual", "paper"}));
  app.add_option("--base-channels", options.base_channels, "Widths")->delimiter(',');
  app.add_option("--blocks", options.blocks, "Blocks of each stage (residual)")->delimiter(',');
  app.add_option("--resolution", options.resolution, "Pixels a side");
  app.add_option("--batch", options.batch, "Images at a time");
  app.add_option("--threads", options.threads, "Of torch");
  app.add_option("--seconds", options.seconds, "Of each measurement");
  CLI11_PARSE(app, argc, argv);
  set_torch_threads(options.threads);
  fmt::print("{} x {} pixels, batches of {}, {} threads; images/s and CPU-seconds per 1000\n",
             options.resolution, options.resolution, options.batch, options.threads);
  fmt::print("{:12} {:>5} {:>6} {:>11}  {:>12} {:>8}  {:>12} {:>8}\n", "architecture", "width",
             "blocks", "10^6 weights", "training/s", "CPU", "prediction/s", "CPU");
  for (const std::string& architecture : options.architectures) {
    for (const uint32_t base : options.base_channels) {
      for (const uint32_t blocks : options.blocks) {
        bench(options, architecture, base, blocks);
        if (architecture == "paper") {
          break;  // has no blocks of that kind
        }
      }
    }
  }
  return 0;
}

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  return itn::run(argc, argv);
}
