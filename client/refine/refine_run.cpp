#include "client/refine/refine_run.h"

#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>

#include "client/image/preview.h"
#include "client/json.h"
#include "client/panels.h"
#include "client/refine/refine_result.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr const char* kTrajectory = "trajectory.jsonl";

std::optional<v1::RefineState> find_state(const fs::path& folder) {
  const fs::path path = folder / kRefineStateFile;
  if (folder.empty() || !fs::exists(path)) return std::nullopt;
  v1::RefineState state;
  if (!state.ParseFromString(read_file(path, "state"))) {
    throw Error(ErrorKind::kDataLoss,
                fmt::format("{} is damaged; remove the folder to begin anew", path.string()));
  }
  return state;
}

void write_state(const fs::path& folder, const v1::RefineState& state) {
  std::string lines;
  for (const v1::RefineIteration& iteration : state.trajectory())
    lines += to_json(iteration) + "\n";
  write_file_atomically(folder / kTrajectory, lines);
  write_file_atomically(folder / kRefineStateFile, state.SerializeAsString());
}

// What ended it no longer does, where limits were raised.
void raise_limits(const v1::RefineSettings& wanted, v1::RefineState& state) {
  const double former_limit = state.settings().time_limit();
  state.mutable_settings()->set_max_iterations(wanted.max_iterations());
  state.mutable_settings()->set_time_limit(wanted.time_limit());
  for (v1::RefineStartState& start : *state.mutable_starts()) {
    const bool more = start.end() == v1::RefineResult::MAX_ITERATIONS
                          ? start.iterations() < wanted.max_iterations()
                      : start.end() == v1::RefineResult::TIME_LIMIT
                          ? wanted.time_limit() == 0 || wanted.time_limit() > former_limit
                          : false;
    if (more) start.set_end(v1::RefineResult::UNFINISHED);
  }
}

void require_same(const v1::RefineState& state, const v1::RefineSettings& wanted,
                  std::span<const Observation> observations, const RefineRun& run) {
  const auto other = [&](const std::string& what) {
    return invalid_input(
        fmt::format("choose another folder: the refinement in {} {}", run.folder.string(), what));
  };
  if (state.digest() != digest_of(observations)) throw other("is of other images or scenes");
  if (state.origin() != run.origin) {
    throw other(fmt::format("began with {}, not {}", state.origin(), run.origin));
  }
  std::string differences;
  google::protobuf::util::MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&differences);
  if (!differencer.Compare(state.settings(), wanted)) {
    throw other("has other settings (only --max-iterations and --time-limit may change):\n" +
                differences);
  }
}

std::string how_far(const v1::RefineState& state) {
  const int done = state.trajectory_size();
  return fmt::format("{} {} done", done, done == 1 ? "iteration is" : "iterations are");
}

Refinement begin_or_continue(const v1::RefineSettings& settings,
                             std::span<const Observation> observations, const RefineRun& run) {
  std::optional<v1::RefineState> state = find_state(run.folder);
  if (!state) return Refinement(settings, observations, run.starts(), run.seconds_before);
  raise_limits(settings, *state);
  require_same(*state, settings, observations, run);
  spdlog::info("{}: {}", run.folder.string(), how_far(*state));
  return Refinement(observations, *state);
}

// An error says how far it has come.
const v1::RefineIteration& step(Refinement& refinement, const Renderer& renderer,
                                const RefineRun& run) {
  try {
    return refinement.step(renderer);
  } catch (const Error& error) {
    const v1::RefineState state = refinement.state();
    if (run.folder.empty() || state.trajectory().empty()) throw;
    throw Error(error.kind(),
                fmt::format("{}; {}, the same command continues", error.what(), how_far(state)));
  }
}

PanelRow panels_of(const Observation& observation, const Render& fit, double exposure) {
  std::vector<float> image, rendered;
  std::vector<float> on_object;
  for (size_t p = 0; p < observation.radiance.size(); ++p) {
    const bool counts =
        fit.mask[p] > 0.5F && (observation.mask.empty() || observation.mask[p] > 0.5F);
    double mean = 0;
    for (const RenderEstimate& estimate : fit.estimates) {
      mean += estimate.radiance[p] / static_cast<double>(fit.estimates.size());
    }
    image.push_back(counts ? observation.radiance[p] : 0);
    rendered.push_back(counts ? static_cast<float>(exposure * mean) : 0);
    if (counts) on_object.push_back(observation.radiance[p]);
  }
  return compared(image, rendered, static_cast<int>(observation.scene->width),
                  static_cast<int>(observation.scene->height), white_level(on_object));
}

const char* in_words(v1::RefineResult::End end) {
  switch (end) {
    case v1::RefineResult::NOISE_OF_IMAGE: return "more samples would not make it more certain";
    case v1::RefineResult::TOLERANCE: return "the tolerance is reached";
    case v1::RefineResult::MAX_SPP:
      return "as many samples were taken as --max-spp allows; more would make it more certain";
    case v1::RefineResult::MAX_ITERATIONS:
      return "as many iterations were made as --max-iterations allows";
    case v1::RefineResult::TIME_LIMIT: return "the time limit is over";
    default: return "not finished";
  }
}

std::string ending_of(const v1::RefineResult& result) {
  return fmt::format("{} iterations, {:.1f} CPU-s, {:.1f} s: {}\n", result.total_iterations(),
                     result.cpu_seconds(), result.seconds(), in_words(result.end()));
}

}  // namespace

Refinement refine(const v1::RefineSettings& settings, std::span<const Observation> observations,
                  const Renderer& renderer, const RefineRun& run) {
  Refinement refinement = begin_or_continue(with_defaults(settings), observations, run);
  while (!refinement.finished()) {
    const v1::RefineIteration& iteration = step(refinement, renderer, run);
    if (!run.folder.empty()) {
      v1::RefineState state = refinement.state();
      state.set_origin(run.origin);
      write_state(run.folder, state);
    }
    if (run.report) run.report(iteration, refinement.trajectory().size());
  }
  return refinement;
}

void write_outcome(const fs::path& folder, std::span<const v1::RefineResult> results,
                   std::span<const Observation> observations, std::span<const Render> fits,
                   double exposure) {
  for (size_t colour = 0; colour < results.size(); ++colour) {
    const fs::path of_colour = results.size() == 1 ? folder : folder / kRgb.at(colour);
    fs::create_directories(of_colour);
    write_file_atomically(of_colour / kRefineResultFile, to_json(results[colour]) + "\n");
  }
  std::vector<PanelRow> rows;
  for (size_t i = 0; i < observations.size(); ++i) {
    rows.push_back(panels_of(observations[i], fits[i], exposure));
  }
  write_panels(folder / "picture.png", rows);
}

std::string to_text(const v1::RefineResult& result) {
  std::string text = fmt::format("{:20}{:>12}   95 % interval\n", "", "value");
  const auto line = [&](const char* name, const v1::RefinedParameter& p, const char* unit) {
    const std::string interval = result.unfinished() ? "unknown: unfinished"
                                 : result.misfit()
                                     ? "unknown: a misfit"
                                     : fmt::format("{:.4g} to {:.4g}", p.low_95(), p.high_95());
    text += fmt::format("{:20}{:>12}   {:24}{}", name, fmt::format("{:.4g}", p.value()), interval,
                        unit);
    text.erase(text.find_last_not_of(' ') + 1);
    text += "\n";
  };
  line("sigma_t", result.sigma_t(), "1/mm");
  line("albedo", result.albedo(), "");
  line("g", result.g(), "");
  line("sigma_a", result.sigma_a(), "1/mm");
  line("sigma_s (1 - g)", result.sigma_s_reduced(), "1/mm");
  line("diffuse albedo", result.diffuse_albedo(), "");
  line("diffusion length", result.diffusion_length(), "mm");
  for (const v1::RefinedParameter& unknown : result.unknowns())
    line(unknown.name().c_str(), unknown, "");
  if (result.has_exposure()) line("image / render", result.exposure(), "");
  text += fmt::format("correlations: sigma_t, albedo {:.2f}; sigma_t, g {:.2f}; albedo, g {:.2f}\n",
                      result.correlations(0), result.correlations(1), result.correlations(2));
  text += fmt::format("difference of image and render: {:.2g} %",
                      100 * std::sqrt(std::max(0.0, result.loss())));
  if (result.noise_loss() > 0) {
    text += fmt::format("; noise of the image: {:.2g} %", 100 * std::sqrt(result.noise_loss()));
  }
  text += "\n" + ending_of(result);
  for (const std::string& remark : result.remarks()) text += remark + ".\n";
  return text;
}

std::string to_table(std::span<const v1::RefineResult> results) {
  const auto name = [&](size_t colour) {
    return results.size() == kRgb.size() ? kRgb.at(colour) : "luminance";
  };
  std::string text = fmt::format("{:<28}", "");
  for (size_t c = 0; c < results.size(); ++c) text += fmt::format("{:<32}", name(c));
  text += '\n';
  const auto cell = [](const v1::RefineResult& result, const v1::RefinedParameter& p) {
    const std::string interval =
        has_intervals(result) ? fmt::format(" ({:.4g} to {:.4g})", p.low_95(), p.high_95()) : "";
    return fmt::format("{:<32}", fmt::format("{:.4g}{}", p.value(), interval));
  };
  const auto row = [&](const std::string& title, const auto& parameter) {
    text += fmt::format("{:<28}", title);
    for (const v1::RefineResult& result : results) text += cell(result, parameter(result));
    text += '\n';
  };
  row("sigma_s (1 - g)", [](const auto& r) { return r.sigma_s_reduced(); });
  row("sigma_a", [](const auto& r) { return r.sigma_a(); });
  row("diffuse albedo", [](const auto& r) { return r.diffuse_albedo(); });
  row("diffusion length", [](const auto& r) { return r.diffusion_length(); });
  row("sigma_t", [](const auto& r) { return r.sigma_t(); });
  row("albedo", [](const auto& r) { return r.albedo(); });
  // What all colours have in common.
  const auto common = [&](const std::string& title, const v1::RefinedParameter& p) {
    text += fmt::format("{:<28}{}\n", title, cell(results.front(), p));
  };
  const v1::RefinedParameter& g = results.front().g();
  const auto has_this_g = [&](const auto& r) { return r.g().value() == g.value(); };
  if (is_as_given(g)) {
    text += fmt::format("{:<28}{:.4g} (as given)\n", "g", g.value());
  } else if (!std::ranges::all_of(results, has_this_g)) {
    row("g", [](const auto& r) { return r.g(); });
  } else {
    common("g", g);
  }
  for (const v1::RefinedParameter& unknown : results.front().unknowns()) {
    common(unknown.name(), unknown);
  }
  if (results.front().has_exposure()) common("image / render", results.front().exposure());
  text += ending_of(results.front());
  // What colours say alike, once, as remarks begin.
  struct Told {
    std::string beginning, colours, remark;
  };
  std::vector<Told> told;
  for (size_t c = 0; c < results.size(); ++c) {
    for (const std::string& remark : results[c].remarks()) {
      const std::string beginning = remark.substr(0, remark.find_first_of(":0123456789"));
      const auto same = std::ranges::find(told, beginning, &Told::beginning);
      if (same == told.end()) {
        told.push_back({beginning, name(c), remark});
      } else {
        same->colours += fmt::format(", {}", name(c));
      }
    }
  }
  for (const Told& one : told) text += fmt::format("{}: {}.\n", one.colours, one.remark);
  return text;
}

}  // namespace itn
