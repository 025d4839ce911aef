// How long an experiment will take, and how much room: from a miniature of it, made on the spot.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <stop_token>
#include <string>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

struct StageForecast {
  std::string name;
  double seconds = 0;
  uint64_t bytes = 0;  // on disk
};

// The same experiment with few images and steps: every kind of work that it consists of.
v1::Experiment miniature(const v1::Experiment& experiment);

// Of every stage in order. Runs the miniature in a temporary folder, which takes some seconds to a
// few minutes. Throws as run_experiment().
std::vector<StageForecast> forecast(const v1::Experiment& experiment, const RenderPoolOptions& pool,
                                    uint32_t torch_threads, std::stop_token stop);

// Likewise, of a miniature that has been run in a folder, and took so many seconds by stage.
std::vector<StageForecast> extrapolated(const v1::Experiment& experiment,
                                        const v1::Experiment& small,
                                        const std::filesystem::path& run,
                                        std::map<std::string, double> seconds);

}  // namespace itn
