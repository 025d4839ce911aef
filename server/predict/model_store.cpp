#include "server/predict/model_store.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/error.h"
#include "common/learning/checkpoint.h"
#include "common/learning/model_files.h"
#include "common/printable.h"
#include "common/rpc/status.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr const char* kExtension = ".itn";

// The file that changes when a model does.
fs::path file_of(const fs::path& path) {
  std::error_code unknown;  // of a file that cannot be seen: reading it will say why
  return fs::is_directory(path, unknown) ? path / kCheckpointName : path;
}

bool is_named_as_model(const fs::path& path) {
  return path.extension() == kExtension;
}

// Nothing with an error.
std::vector<fs::path> files_in(const fs::path& folder, std::error_code& error) {
  std::vector<fs::path> files;
  for (auto file = fs::directory_iterator(folder, error);
       !error && file != fs::directory_iterator(); file.increment(error)) {
    files.push_back(file->path());
  }
  if (error) files.clear();
  return files;
}

std::string label(const ServedModel& model) {
  return model.version.empty() ? model.name : model.name + " " + model.version;
}

// Fit for messages, logs and the wire.
bool is_plain(const std::string& name) {
  return !name.empty() && printable(name) == name;
}

// NAME=MODEL, unless it is the path of something with such a name.
std::pair<std::string, std::string> parsed(const std::string& text) {
  const size_t equals = text.find('=');
  if (equals == std::string::npos || text.find('/') < equals || fs::exists(text)) return {"", text};
  const std::string name = text.substr(0, equals);
  if (!is_plain(name)) {
    throw Error(ErrorKind::kUsage,
                fmt::format("--model {}: the name before = must be of up to 80 printable ASCII "
                            "characters",
                            printable(text)));
  }
  return {name, text.substr(equals + 1)};
}

// What a network of NaN, or one that overflows, would not.
void check_answers_with_numbers(const Predictor& predictor, const fs::path& path) {
  const int64_t side = predictor.model().resolution();
  const auto channels = static_cast<int64_t>(predictor.channels());
  ImageBatch plain;
  plain.channels = channels;
  plain.luminance =
      torch::ones({channels, side, side}) / static_cast<float>(predictor.model().image_scale());
  plain.mask = torch::ones({channels, side, side});
  if (needs_weight_map(predictor.model().input())) plain.weight = torch::ones({1, side, side});
  const std::vector<MaterialEstimate> estimates = predictor.estimate(plain);
  for (const double output : estimates.front().outputs) {
    if (!std::isfinite(output)) {
      throw invalid_input(fmt::format(
          "{}: its network answers a plain image with {}; was its training stopped in time?",
          path.string(), output));
    }
  }
}

[[noreturn]] void throw_not_found(const std::string& message) {
  throw StatusError({grpc::StatusCode::NOT_FOUND, message});
}

}  // namespace

bool is_older(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  // From `at` on: a number without its leading zeros, or one character.
  const auto part = [&](const std::string& text, size_t& at) {
    const size_t begin = at++;
    if (!is_digit(text[begin])) return text.substr(begin, 1);
    while (at < text.size() && is_digit(text[at])) ++at;
    const std::string digits = text.substr(begin, at - begin);
    return digits.substr(std::min(digits.find_first_not_of('0'), digits.size() - 1));
  };
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    const std::string x = part(a, i), y = part(b, j);
    const bool numbers = is_digit(x.front()) && is_digit(y.front());
    if (numbers && x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  return i == a.size() && j < b.size();
}

ModelStore::ModelStore(const ModelStoreOptions& options) : folder_(options.folder) {
  for (const std::string& text : options.models) {
    const auto [name, model] = parsed(text);
    Slot slot;
    slot.path = find_model(model);
    // By name alone: a model that comes with itn.
    slot.name = name.empty() && slot.path != model ? slot.path.stem().string() : name;
    load(slot);
    for (const Slot& other : slots_) {
      if (label(*other.served) == label(*slot.served)) {
        throw Error(ErrorKind::kUsage,
                    fmt::format("--model {}: it would be served as {}, as is {}; give it another "
                                "name: --model NAME={}",
                                printable(text), label(*slot.served), other.path.string(), model));
      }
    }
    slots_.push_back(std::move(slot));
  }
  for (const Slot& slot : slots_) default_names_.push_back(slot.served->name);
  if (!folder_.empty() && !fs::is_directory(folder_)) {
    throw Error(ErrorKind::kIo, fmt::format("--models {}: it is not a folder", folder_.string()));
  }
  refresh();
  if (models().empty()) {
    throw Error(ErrorKind::kIo,
                fmt::format("--models {}: there is no model in it that can be used; "
                            "they are called NAME.itn or NAME/VERSION.itn",
                            folder_.string()));
  }
}

void ModelStore::warn_once(const std::string& warning) {
  if (warnings_.insert(warning).second && !warned_.contains(warning)) spdlog::warn(warning);
}

std::vector<fs::path> ModelStore::known_in(const fs::path& subfolder) const {
  std::vector<fs::path> files;
  for (const Slot& slot : slots_) {
    if (slot.in_folder && slot.path.parent_path() == subfolder) files.push_back(slot.path);
  }
  return files;
}

std::vector<ModelStore::Slot> ModelStore::slots_of_folder() {
  std::vector<Slot> slots;
  const auto add = [&](const fs::path& path, const std::string& name,
                       const std::optional<std::string>& version) {
    if (!is_named_as_model(path)) return;
    if (!is_plain(name) || (version && !is_plain(*version))) {
      warn_once(fmt::format(
          "{} is left out: names and versions are of up to 80 printable ASCII characters",
          printable(path.string(), 500)));
      return;
    }
    Slot& slot = slots.emplace_back();
    slot.path = path;
    slot.name = name;
    slot.version = version;
    slot.in_folder = true;
  };
  if (folder_.empty()) return slots;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) {
    const fs::path& path = entry.path();
    std::error_code error;
    if (!entry.is_directory(error) && (!error || is_named_as_model(path))) {
      add(path, path.stem().string(), std::nullopt);
      continue;
    }
    std::vector<fs::path> files;
    if (!error) files = files_in(path, error);
    if (error) {
      files = known_in(path);
      warn_once(fmt::format("{} cannot be read: {}; models found in it before go on answering",
                            printable(path.string(), 500), error.message()));
    }
    for (const fs::path& file : files) add(file, path.filename().string(), file.stem().string());
  }
  std::ranges::sort(slots, {}, &Slot::path);
  return slots;
}

// The stamp is taken first: what is written later then shows.
void ModelStore::load(Slot& slot) const {
  slot.stamp = stamp_of(file_of(slot.path).string());
  slot.failed = true;
  auto predictor = std::make_shared<const Predictor>(Predictor::load(slot.path));
  check_answers_with_numbers(*predictor, slot.path);
  const v1::ModelVersion& version = predictor->version();
  if (slot.name.empty()) slot.name = version.name();
  slot.served = {.name = slot.name,
                 .version = slot.version.value_or(version.version()),
                 .title = card_title(slot.path),
                 .predictor = std::move(predictor)};
  slot.failed = false;
  spdlog::info("model {}: {}, weights {:.12}, from {}", label(*slot.served), itn::name(version),
               version.sha256(), slot.path.string());
}

void ModelStore::look_into_folder() {
  std::vector<Slot> found;
  try {
    found = slots_of_folder();
  } catch (const fs::filesystem_error& error) {
    // Not read is not empty: too many open files, or a server of files that is away. Nor is what it
    // was warned of in the folder well again.
    warnings_.insert(warned_.begin(), warned_.end());
    warn_once(fmt::format("--models {}: {}; its models of before go on answering", folder_.string(),
                          error.code().message()));
    return;
  }
  for (Slot& slot : slots_) {
    if (!slot.in_folder) continue;
    const auto still = std::ranges::find(found, slot.path, &Slot::path);
    if (still != found.end()) {
      *still = std::move(slot);
    } else if (slot.served) {
      spdlog::info("model {}: no longer served: {} is gone", label(*slot.served),
                   slot.path.string());
    }
  }
  std::erase_if(slots_, [](const Slot& slot) { return slot.in_folder; });
  std::ranges::move(found, std::back_inserter(slots_));
}

void ModelStore::refresh(bool again) {
  const std::lock_guard lock(refreshing_);
  look_into_folder();
  for (Slot& slot : slots_) {
    const bool changed = stamp_of(file_of(slot.path).string()) != slot.stamp;
    if (!changed && !(again && slot.failed)) continue;
    try {
      load(slot);
    } catch (const std::exception& error) {  // memory that could not be had, too
      spdlog::error(
          "{}; {}", error.what(),
          slot.served ? fmt::format("model {} of before goes on answering (weights {:.12})",
                                    label(*slot.served), slot.served->predictor->version().sha256())
                      : "it is not served");
    }
  }
  publish();
  warned_ = std::exchange(warnings_, {});
}

void ModelStore::publish() {
  std::vector<ServedModel> served;
  std::set<std::string> names;
  for (const Slot& slot : slots_) {
    if (!slot.served) continue;
    const auto same = [&](const ServedModel& other) { return label(other) == label(*slot.served); };
    if (std::ranges::any_of(served, same)) {
      warn_once(fmt::format("model {}: there are two; that of {} is not served",
                            label(*slot.served), slot.path.string()));
      continue;
    }
    served.push_back(*slot.served);
    names.insert(slot.name);
  }
  std::ranges::stable_sort(served, [](const ServedModel& a, const ServedModel& b) {
    return a.name != b.name ? a.name < b.name : is_older(b.version, a.version);
  });
  std::vector<std::string> by_default = default_names_;
  if (by_default.empty() && names.size() == 1) by_default = {*names.begin()};
  if (by_default.empty()) by_default = {kDefaultModel, kDefaultGrayModel};
  std::optional<size_t> fewest_channels;  // that a default takes so far
  for (const std::string& name : by_default) {
    const auto newest = std::ranges::find(served, name, &ServedModel::name);
    if (newest == served.end()) continue;
    const size_t channels = newest->predictor->channels();
    newest->by_default = !fewest_channels || channels < *fewest_channels;
    if (newest->by_default) fewest_channels = channels;
  }
  const std::lock_guard lock(mutex_);
  served_ = std::move(served);
}

std::vector<ServedModel> ModelStore::models() const {
  const std::lock_guard lock(mutex_);
  return served_;
}

std::shared_ptr<const Predictor> ModelStore::find(const std::string& name,
                                                  const std::string& version,
                                                  size_t channels) const {
  const std::lock_guard lock(mutex_);
  auto by_default = std::ranges::find_if(served_, [channels](const ServedModel& model) {
    return model.by_default && model.predictor->channels() == channels;
  });
  if (by_default == served_.end()) {
    by_default = std::ranges::find(served_, true, &ServedModel::by_default);
  }
  const std::string wanted = name.empty() && by_default != served_.end() ? by_default->name : name;
  std::vector<std::string> names, versions;
  for (const ServedModel& model : served_) {
    if (names.empty() || names.back() != model.name) names.push_back(model.name);
    if (model.name != wanted) continue;
    if (version.empty() || model.version == version) return model.predictor;
    versions.push_back(model.version.empty() ? "one without a version" : model.version);
  }
  if (!versions.empty()) {
    throw_not_found(fmt::format("this predictor has no version {} of the model {}; it has {}",
                                printable(version), wanted, fmt::join(versions, ", ")));
  }
  const std::string existing = names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "));
  throw_not_found(
      wanted.empty()
          ? fmt::format("this predictor has no default model: name one; it has {}", existing)
          : fmt::format("this predictor has no model {}; it has {}", printable(wanted), existing));
}

}  // namespace itn
