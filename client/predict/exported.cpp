#include "client/predict/exported.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "client/exports/rgb_material.h"
#include "client/output.h"
#include "client/predict/answer_warnings.h"
#include "client/predict/prediction.h"
#include "common/files/atomic_file.h"

namespace itn {

namespace fs = std::filesystem;

namespace {

std::string intervals_of(const v1::Prediction::Channel& channel) {
  const v1::MaterialPosterior& p = channel.posterior();
  return fmt::format(
      "{}: 90 % intervals: sigma_t {:.4g} to {:.4g} 1/mm, albedo {:.3f} to {:.3f}, g {:.3f} to "
      "{:.3f}",
      channel.channel(), p.sigma_t().low(), p.sigma_t().high(), p.albedo().low(), p.albedo().high(),
      p.g().low(), p.g().high());
}

}  // namespace

std::string exported(const v1::Prediction& prediction, const ExportFormat& format,
                     ExportOptions options) {
  if (prediction.has_object_size()) options.object_size_mm = prediction.object_size();
  options.provenance = fmt::format("{}, image {}", prediction.model(), prediction.image());
  for (const v1::Prediction::Channel& channel : prediction.channels()) {
    if (channel.has_posterior()) options.notes.push_back(intervals_of(channel));
  }
  for (const Limit& limit : limits_of(prediction)) {
    options.notes.push_back((limit.is_grave ? "DO NOT TRUST THIS: " : "") + limit.text);
  }
  return format.write(rgb_material(materials_of_1_mm(prediction)), options);
}

fs::path exported_file(const fs::path& folder, const std::string& image,
                       const ExportFormat& format) {
  return folder / (fs::path(image).stem().string() + std::string(format.extension));
}

namespace {

// Renderers have one g for all channels; the differences go into the scattering coefficients, which
// shows where they are large (docs/exports.md has figures).
void warn_of_common_g(const v1::Prediction& prediction) {
  constexpr double kLarge = 0.3;
  const auto [least, most] = std::ranges::minmax(
      prediction.channels(), {}, [](const v1::Prediction::Channel& c) { return c.g(); });
  if (most.g() - least.g() > kLarge) {
    spdlog::warn(
        "{}: g is {:.2f} in {} and {:.2f} in {}; the file has one for all channels, so "
        "that dark channels may render some per cent off",
        prediction.image(), least.g(), least.channel(), most.g(), most.channel());
  }
}

// In the file nobody would see it in time.
void warn(const v1::Prediction& prediction) {
  warn_of_common_g(prediction);
  for (const v1::Prediction::Channel& channel : prediction.channels()) {
    const v1::OutlierScore& outlier = channel.caveats().outlier();
    if (outlier.is_outlier()) {
      spdlog::warn("{}, channel {}: an outlier, do not trust this answer ({})", prediction.image(),
                   channel.channel(), outlier.reason());
    }
  }
  for (const v1::Prediction::Channel& channel : prediction.channels()) {
    for (const v1::Warning& warning : channel.caveats().warnings()) {
      if (!in_all_channels(prediction, warning)) {
        spdlog::warn("{}, channel {}: {}", prediction.image(), channel.channel(), warning.text());
      }
    }
  }
  for (const v1::Warning& warning : prediction.channels(0).caveats().warnings()) {
    if (in_all_channels(prediction, warning)) {
      spdlog::warn("{}: {}", prediction.image(), warning.text());
    }
  }
}

class ExportPrinter final : public PredictionPrinter {
 public:
  ExportPrinter(const ExportFormat& format, ExportOptions options, ExportTarget target)
      : format_(format), options_(std::move(options)), target_(std::move(target)) {}

  void print(const v1::Prediction& prediction) override {
    if (!prediction.error().empty()) {
      spdlog::error("{}: {}", prediction.image(), prediction.error());
      return;
    }
    if (target_.combined_alone && !prediction.combined()) return;
    warn(prediction);
    const std::string text = exported(prediction, format_, options_);
    if (target_.path.empty()) {
      print_result(text);
    } else {
      write_file_atomically(file_of(prediction), text);
    }
  }

 private:
  fs::path file_of(const v1::Prediction& prediction) const {
    return target_.is_folder ? exported_file(target_.path, prediction.image(), format_)
                             : target_.path;
  }

  const ExportFormat& format_;
  ExportOptions options_;
  ExportTarget target_;
};

}  // namespace

std::unique_ptr<PredictionPrinter> export_printer(const ExportFormat& format, ExportOptions options,
                                                  ExportTarget target) {
  return std::make_unique<ExportPrinter>(format, std::move(options), std::move(target));
}

}  // namespace itn
