#include "client/dataset/dataset_render.h"

#include <algorithm>
#include <deque>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>
#include <spdlog/spdlog.h>

#include "client/render_pool/render_wait.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/folder_lock.h"
#include "common/image/attributes.h"
#include "common/image/image.h"
#include "common/rpc/wire_array.h"
#include "server/tracer/render.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

using google::protobuf::util::MessageDifferencer;

// The first lines of what differs, e.g. "modified: spp: 64 -> 256"; empty if nothing does.
template <typename Message>
std::string difference(const Message& there, const Message& wanted) {
  std::string text;
  MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&text);
  differencer.Compare(there, wanted);
  constexpr size_t kMaxLines = 4;
  size_t end = 0;
  for (size_t line = 0; line < kMaxLines && end != std::string::npos; ++line) {
    end = text.find('\n', end + 1);
  }
  return text.substr(0, end);
}

Error another_dataset(const fs::path& folder, const std::string& differences) {
  return invalid_input(
      fmt::format("{} holds a dataset of another configuration; choose another folder, or the same "
                  "configuration to continue it. Differences:\n{}",
                  folder.string(), differences));
}

// Writes the manifest and the shapes, or finds them there.
void set_up_folder(const DatasetPlan& plan, const fs::path& folder) {
  const fs::path manifest = folder / kManifestName;
  if (fs::exists(manifest)) {
    const v1::Dataset there = read_manifest(manifest);
    // Items follow from the configuration and the shapes, so the configuration says it best.
    require_same_config(there, plan.manifest.config(), folder);
    const std::string differences = difference(there, plan.manifest);
    if (!differences.empty()) {
      throw another_dataset(folder, differences);
    }
  } else if (!fs::exists(folder / "shapes")) {
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (entry.path().filename() != FolderLock::kName) {
        throw invalid_input(fmt::format(
            "{} is not empty and holds no dataset; choose another folder", folder.string()));
      }
    }
  }
  std::error_code error;
  for (const char* name : {"images", "shapes"}) {
    fs::create_directories(folder / name, error);
    if (error) {
      throw Error(ErrorKind::kIo,
                  fmt::format("cannot create {}: {}", (folder / name).string(), error.message()));
    }
  }
  for (const v1::DatasetShape& shape : plan.manifest.shapes()) {
    const auto to_file = plan.shape_files.find(shape.file());
    if (to_file != plan.shape_files.end() && !holds_shape(folder, shape)) {
      write_file_atomically(folder / shape.file(), to_file->second());
    }
  }
  write_file_atomically(manifest, to_text(plan.manifest));
}

bool is_rendered(const DatasetReader& dataset, const v1::DatasetItem& item, const fs::path& file) {
  if (!fs::exists(file)) {
    return false;
  }
  try {
    dataset.image(item);
    return true;
  } catch (const Error& error) {
    spdlog::warn("rendering again: {}", error.what());
    return false;
  }
}

// Items whose scenes are the same and whose materials differ in the albedo alone: one walk renders
// them all. The first has the largest albedo. A group follows from the manifest, not from what is
// missing, so that images do not depend on what was rendered when.
using Group = std::vector<const v1::DatasetItem*>;

std::vector<Group> groups_of(const v1::Dataset& manifest) {
  std::map<std::tuple<std::string, float, float, double, double>, size_t> open;  // by scene
  std::vector<Group> groups;
  for (const v1::DatasetItem& item : manifest.items()) {
    const auto [place, is_new] =
        open.try_emplace({item.shape(), item.rotate_y_degrees(), item.sun_azimuth_degrees(),
                          item.material().sigma_t(), item.material().g()},
                         groups.size());
    if (is_new || groups[place->second].size() == 1 + tracer::kMaxAlbedos) {
      place->second = groups.size();
      groups.emplace_back();
    }
    groups[place->second].push_back(&item);
  }
  for (Group& group : groups) {
    std::ranges::stable_sort(group, std::ranges::greater(),
                             [](const v1::DatasetItem* item) { return item->material().albedo(); });
  }
  // One shape after the other: each is loaded once, and workers that hold its mesh have use for it.
  std::ranges::stable_sort(groups, {}, [](const Group& group) { return group.front()->shape(); });
  return groups;
}

// The floor is not rendered: a network sees the object alone.
RenderJob render_job(DatasetReader& dataset, const Group& group) {
  const v1::DatasetItem& first = *group.front();
  RenderJob job;
  job.scene = dataset.scene(first);
  *job.request.mutable_material() = first.material();
  job.request.set_spp(dataset.manifest().config().spp());
  job.request.set_seed(first.seed());
  job.request.set_pixels(v1::OBJECT_PIXELS);
  for (size_t i = 1; i < group.size(); ++i) {
    job.request.add_albedos(group[i]->material().albedo());
  }
  return job;
}

uint64_t dropped(const v1::Counters& counters) {
  return counters.invalid_samples() + counters.leaks();
}

// The image of the group's item number `member`. The noise is that of the first one's; those of
// lower albedos have less.
Image image_of(const DatasetReader& dataset, const Group& group, size_t member,
               const v1::RenderGradReply& reply) {
  const v1::DatasetItem& item = *group[member];
  const v1::Estimate& estimate = reply.estimates(0);
  Image image;
  image.width = static_cast<int>(reply.width());
  image.height = static_cast<int>(reply.height());
  image.channels["Y"] = from_bytes<float>(
      member == 0 ? estimate.radiance() : estimate.at_albedos(static_cast<int>(member) - 1));
  image.channels["mask.Y"] = from_bytes<float>(reply.mask());
  image.channels["stderr.Y"] = from_bytes<float>(reply.standard_error());
  image.attributes = {
      {attribute::kVersion, ITN_VERSION},
      {attribute::kSigmaT, item.material().sigma_t()},
      {attribute::kAlbedo, item.material().albedo()},
      {attribute::kG, item.material().g()},
      {attribute::kShape, item.shape()},
      {attribute::kRotateY, item.rotate_y_degrees()},
      {attribute::kSunAzimuth, item.sun_azimuth_degrees()},
      {attribute::kSplit, v1::Split_Name(item.split())},
      {attribute::kSeed, std::to_string(group.front()->seed())},
      {attribute::kSpp, static_cast<int>(dataset.manifest().config().spp())},
      {attribute::kInvalidSamples, static_cast<double>(reply.counters().invalid_samples())},
      {attribute::kLeaks, static_cast<double>(reply.counters().leaks())},
      {attribute::kItem, item_digest(dataset.manifest(), item)},
  };
  return image;
}

v1::RenderGradReply wait_or_say_how_far(std::future<v1::RenderGradReply>& reply,
                                        const DatasetProgress& progress, std::stop_token stop) {
  try {
    return wait_for_render(reply, stop);
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{} after {} of {} images; the same command continues",
                                          error.what(), progress.done, progress.total));
  }
}

struct PendingGroup {
  const Group* group;
  std::future<v1::RenderGradReply> reply;
};

}  // namespace

void require_same_config(const v1::Dataset& there, const v1::DatasetConfig& wanted,
                         const fs::path& folder) {
  const std::string differences = difference(there.config(), wanted);
  if (!differences.empty()) {
    throw another_dataset(folder, differences);
  }
}

DatasetProgress render_dataset(const DatasetPlan& plan, const fs::path& folder, RenderPool& pool,
                               const std::function<void(const DatasetProgress&)>& report,
                               std::stop_token stop) {
  const FolderLock lock(folder, "itn dataset");
  set_up_folder(plan, folder);
  for (const char* below : {"", "images", "shapes"}) {
    lock.remove_temporary_files(below);
  }
  DatasetReader dataset(folder);
  // Keep what is there.
  DatasetProgress progress;
  progress.total = static_cast<size_t>(plan.manifest.items_size());
  const std::vector<Group> groups = groups_of(dataset.manifest());
  std::set<const v1::DatasetItem*> missing;
  std::deque<const Group*> waiting;
  for (const Group& group : groups) {
    bool complete = true;
    for (const v1::DatasetItem* item : group) {
      if (is_rendered(dataset, *item, path_inside(folder, item->file()))) {
        ++progress.kept;
      } else {
        missing.insert(item);
        complete = false;
      }
    }
    if (!complete) {
      waiting.push_back(&group);
    }
  }
  progress.done = progress.kept;
  report(progress);
  // Render the rest, with enough jobs waiting that no worker is ever idle.
  const size_t ahead = 2 * static_cast<size_t>(pool.parallelism()) + 1;
  std::deque<PendingGroup> pending;
  while (!waiting.empty() || !pending.empty()) {
    while (!waiting.empty() && pending.size() < ahead) {
      pending.push_back({waiting.front(), pool.submit(render_job(dataset, *waiting.front()))});
      waiting.pop_front();
    }
    const Group& group = *pending.front().group;
    const v1::RenderGradReply reply = wait_or_say_how_far(pending.front().reply, progress, stop);
    progress.paths += reply.counters().paths();
    progress.dropped += dropped(reply.counters());
    for (size_t member = 0; member < group.size(); ++member) {
      if (missing.contains(group[member])) {
        write_exr(folder / group[member]->file(), image_of(dataset, group, member, reply));
        ++progress.done;
        report(progress);
      }
    }
    pending.pop_front();
  }
  return progress;
}

}  // namespace itn
