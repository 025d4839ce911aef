#include "common/learning/model_files.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <system_error>

#include "common/error.h"
#include "common/files/read_file.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr const char* kExtension = ".itn";

// A name, not a path.
bool is_name(const std::string& model) {
  return model.find('/') == std::string::npos && !model.ends_with(kExtension);
}

std::string available_models() {
  std::vector<std::string> names;
  for (const ShippedModel& model : shipped_models()) names.push_back(model.name);
  const std::string folder = models_folder().string();
  return names.empty() ? fmt::format("there is no model in {}", folder)
                       : fmt::format("in {} there are {}", folder, fmt::join(names, ", "));
}

// Refuses a name that was given as that of a file where no such file is.
void refuse_name_with_extension(const std::string& model) {
  const fs::path path = model;
  const std::string name = path.stem().string();
  if (path.extension() != kExtension || fs::exists(path)) return;
  if (!fs::exists(models_folder() / path.filename())) return;
  throw Error(ErrorKind::kIo,
              fmt::format("cannot read the checkpoint {}: No such file or directory; the model "
                          "that comes with itn is called {}: --model {}",
                          model, name, name));
}

}  // namespace

fs::path models_folder() {
  if (const char* folder = std::getenv("ITN_MODELS"); folder != nullptr && *folder != '\0') {
    return folder;
  }
  const fs::path program = fs::read_symlink("/proc/self/exe");
  return program.parent_path().parent_path() / "share" / "itn" / "models";
}

std::string card_title(const fs::path& model) {
  constexpr uint64_t kMaxCardBytes = uint64_t{1} << 20;
  fs::path card = model;
  card.replace_extension(".md");
  if (!fs::is_regular_file(card)) return {};
  std::string line = read_file(card, "model card", kMaxCardBytes);
  line = line.substr(0, line.find('\n'));
  return line.substr(std::min(line.find_first_not_of("# "), line.size()));
}

std::vector<ShippedModel> shipped_models() {
  std::vector<ShippedModel> models;
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(models_folder(), none)) {
    if (entry.path().extension() != kExtension) continue;
    models.push_back({.name = entry.path().stem().string(),
                      .file = entry.path(),
                      .title = card_title(entry.path())});
  }
  std::ranges::sort(models, {}, &ShippedModel::name);
  return models;
}

fs::path find_model(const std::string& model, const std::string& by_default) {
  if (!model.empty() && (!is_name(model) || fs::exists(model))) {
    refuse_name_with_extension(model);
    return model;
  }
  const std::string name = model.empty() ? by_default : model;
  const fs::path file = models_folder() / (name + kExtension);
  if (fs::exists(file)) return file;
  throw Error(
      ErrorKind::kIo,
      model.empty()
          ? fmt::format("no model is named, and the one that is taken then, {}, is missing: "
                        "{}; give one that itn train made with --model FILE",
                        name, available_models())
          : fmt::format("{} is neither a file or folder nor the name of a model: {}", model,
                        available_models()));
}

}  // namespace itn
