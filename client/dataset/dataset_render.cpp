#include "client/dataset/dataset_render.h"

#include <algorithm>
#include <deque>
#include <fstream>
#include <functional>
#include <future>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>

#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>
#include <spdlog/spdlog.h>

#include "client/dataset/noise.h"
#include "client/files/folder_lock.h"
#include "client/image/attributes.h"
#include "client/image/image.h"
#include "client/render/job_renderer.h"
#include "client/render/render_query.h"
#include "client/render/reply_images.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/render_limits.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

using google::protobuf::util::MessageDifferencer;

// The first lines of what differs, e.g. "modified: spp: 64 -> 256"; empty if nothing does.
template <typename Message>
std::string difference(const Message& existing, const Message& wanted) {
  std::string text;
  MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&text);
  differencer.Compare(existing, wanted);
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

// The dataset that is there must be the beginning of the one that is planned. A shape whose digest
// is not known before it is built has that of its file.
void require_beginning(const v1::Dataset& existing, v1::Dataset& planned, const fs::path& folder) {
  // Items follow from the configuration and the shapes, so the configuration says it best.
  require_same_config(existing, planned.config(), folder);
  for (int i = 0; i < std::min(existing.shapes_size(), planned.shapes_size()); ++i) {
    if (planned.shapes(i).sha256().empty()) {
      planned.mutable_shapes(i)->set_sha256(existing.shapes(i).sha256());
    }
  }
  v1::Dataset beginning = planned;
  beginning.mutable_config()->set_count(existing.config().count());
  if (beginning.items_size() > existing.items_size()) {
    beginning.mutable_items()->DeleteSubrange(existing.items_size(),
                                              beginning.items_size() - existing.items_size());
  }
  const std::string differences = difference(existing, beginning);
  if (!differences.empty()) throw another_dataset(folder, differences);
}

void require_empty(const fs::path& folder) {
  if (fs::exists(folder / "shapes")) return;  // a dataset that was stopped before its manifest
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename() != FolderLock::kName) {
      throw invalid_input(fmt::format("{} is not empty and holds no dataset; choose another folder",
                                      folder.string()));
    }
  }
}

// Writes the file of a shape or a panorama, unless it is there or not to be had. Each shape is
// built once, and held while it is written.
template <typename Entry>
void write_part(const DatasetPlan& plan, const fs::path& folder, Entry& entry) {
  const auto to_file = plan.files.find(entry.file());
  if (to_file == plan.files.end()) return;
  if (!entry.sha256().empty() && holds_file(folder, entry.file(), entry.sha256())) return;
  const std::string bytes = to_file->second();
  entry.set_sha256(to_hex(sha256(bytes)));
  write_file_atomically(folder / entry.file(), bytes);
}

// Writes the manifest, the shapes and the panoramas, or finds them there.
void set_up_folder(DatasetPlan& plan, const fs::path& folder, const std::stop_token& stop) {
  const fs::path manifest = folder / kManifestName;
  if (fs::exists(manifest)) {
    require_beginning(read_manifest(manifest), plan.manifest, folder);
  } else {
    require_empty(folder);
  }
  std::error_code error;
  // By the folder of the shapes a dataset is known that was stopped before its manifest.
  std::vector<const char*> folders = {"shapes", "images"};
  if (!plan.manifest.panoramas().empty()) folders.push_back("panoramas");
  for (const char* name : folders) {
    fs::create_directories(folder / name, error);
    if (error) {
      throw Error(ErrorKind::kIo,
                  fmt::format("cannot create {}: {}", (folder / name).string(), error.message()));
    }
  }
  for (v1::DatasetShape& shape : *plan.manifest.mutable_shapes()) {
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    write_part(plan, folder, shape);
  }
  for (v1::DatasetPanorama& panorama : *plan.manifest.mutable_panoramas()) {
    write_part(plan, folder, panorama);
  }
  write_file_atomically(manifest, to_text(plan.manifest));
}

bool is_rendered(const DatasetReader& dataset, const v1::DatasetItem& item, const fs::path& file) {
  if (!fs::exists(file)) return false;
  try {
    dataset.channels(item);
    return true;
  } catch (const Error& error) {
    spdlog::warn("rendering again: {}", error.what());
    return false;
  }
}

// Items whose scenes are the same and whose materials differ in the albedo alone: one walk renders
// them all. The first has the largest albedo. A group follows from the manifest, not from what is
// missing, so that images do not depend on what was rendered when. With a noise target there are
// none: each image has samples of its own. Nor are there with derivatives, which a walk has of one
// albedo.
using Group = std::vector<const v1::DatasetItem*>;

// What the items of a group have in common.
std::string group_key(v1::DatasetItem item) {
  item.clear_file();
  item.clear_seed();
  item.mutable_material()->clear_albedo();
  return item.SerializeAsString();
}

std::vector<Group> groups_of(const v1::Dataset& manifest) {
  const bool is_grid = manifest.config().materials().sampling() == v1::MaterialChoice::GRID;
  const bool shared = is_grid && !manifest.config().has_noise() && !manifest.config().derivatives();
  std::unordered_map<std::string, size_t> open;
  std::vector<Group> groups;
  for (const v1::DatasetItem& item : manifest.items()) {
    if (!shared) {
      groups.push_back({&item});
      continue;
    }
    const auto [place, is_new] = open.try_emplace(group_key(item), groups.size());
    if (is_new || groups[place->second].size() == 1 + kMaxAlbedos) {
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
  std::ranges::stable_sort(
      groups, {}, [](const Group& group) -> const std::string& { return group.front()->shape(); });
  return groups;
}

uint64_t dropped(const v1::Counters& counters) {
  return counters.invalid_samples() + counters.leaks();
}

// What the header says of the item.
std::map<std::string, Attribute> attributes_of(const v1::DatasetItem& item) {
  std::map<std::string, Attribute> attributes = {
      {attribute::kVersion, ITN_VERSION},
      {attribute::kShape, item.shape()},
      {attribute::kSplit, v1::Split_Name(item.split())},
  };
  const auto add_truth = [&](const v1::Material& material, const std::string& channel) {
    attributes[attribute::kSigmaT + channel] = material.sigma_t();
    attributes[attribute::kAlbedo + channel] = material.albedo();
    attributes[attribute::kG + channel] = material.g();
  };
  if (item.has_material()) add_truth(item.material(), "");
  for (int c = 0; c < item.colours_size(); ++c)
    add_truth(item.colours(c), fmt::format(".{}", kColourChannels[c]));
  if (item.light().has_sun_sky()) {
    attributes[attribute::kSunAzimuth] = item.light().sun_sky().sun_azimuth_degrees();
  }
  return attributes;
}

void add_derivatives(const v1::RenderGradReply& reply, Image& image) {
  for (int k = 0; k < kDerivativeEstimates; ++k) {
    for (int i = 0; i < 3; ++i) {
      image.channels[estimate_channel(k, kMaterialParameters[static_cast<size_t>(i)])] =
          from_bytes<float>(reply.estimates(k).derivatives(i));
    }
  }
}

// What was rendered for a group, by channel of its images.
struct RenderedGroup {
  const Group* group = nullptr;
  std::vector<uint32_t> spp = {};  // of each render
  std::vector<v1::RenderGradReply> replies = {};
  uint64_t invalid_samples = 0, leaks = 0;
};

// The channels of one that has no colours. The noise is that of the group's first item; those of
// lower albedos have less.
void add_luminance(const RenderedGroup& rendered, size_t member, Image& image) {
  const v1::RenderGradReply& reply = rendered.replies.front();
  image.channels["Y"] =
      member == 0 ? mean_radiance(reply, rendered.spp.front())
                  : from_bytes<float>(reply.estimates(0).at_albedos(static_cast<int>(member) - 1));
  image.channels["stderr.Y"] = from_bytes<float>(reply.standard_error());
}

void add_colours(const RenderedGroup& rendered, Image& image) {
  for (size_t c = 0; c < kColourChannels.size(); ++c) {
    const std::string name = kColourChannels[c];
    image.channels[name] = from_bytes<float>(rendered.replies[c].estimates(0).radiance());
    image.channels["stderr." + name] = from_bytes<float>(rendered.replies[c].standard_error());
  }
}

// Of the noisiest channel.
double noise_of(const Image& image, const v1::DatasetItem& item) {
  double most = 0;
  for (const std::string& name : channel_names(item)) {
    most = std::max(most, relative_noise(image.channel(name), image.channel("stderr." + name),
                                         image.channel("mask.Y")));
  }
  return most;
}

// The image of the group's item number `member`.
Image image_of(const DatasetReader& dataset, const RenderedGroup& rendered, size_t member) {
  const Group& group = *rendered.group;
  const v1::DatasetItem& item = *group[member];
  const v1::RenderGradReply& reply = rendered.replies.front();
  Image image;
  image.width = static_cast<int>(reply.width());
  image.height = static_cast<int>(reply.height());
  image.channels["mask.Y"] = from_bytes<float>(reply.mask());
  if (item.colours().empty()) {
    add_luminance(rendered, member, image);
  } else {
    add_colours(rendered, image);
  }
  if (dataset.manifest().config().derivatives()) add_derivatives(reply, image);
  image.attributes = attributes_of(item);
  image.attributes[attribute::kSeed] = std::to_string(group.front()->seed());
  image.attributes[attribute::kSpp] = static_cast<int>(std::ranges::max(rendered.spp));
  image.attributes[attribute::kRelativeNoise] = noise_of(image, item);
  image.attributes[attribute::kInvalidSamples] = static_cast<double>(rendered.invalid_samples);
  image.attributes[attribute::kLeaks] = static_cast<double>(rendered.leaks);
  image.attributes[attribute::kItem] = dataset.digest(item);
  image.attributes[attribute::kContents] = contents_digest(image);
  return image;
}

template <typename Action>
auto with_progress_in_error(const DatasetProgress& progress, const Action& action) {
  try {
    return action();
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{} after {} of {} images; the same command continues",
                                          error.what(), progress.done, progress.total));
  }
}

// Renders one group after the other, after its pilot if there is a noise target, with enough of
// both under way that no worker is ever idle. What it renders does not depend on when.
class GroupRenderer {
 public:
  // Waits for a render, and throws what became of it.
  using Wait = std::function<v1::RenderGradReply(std::future<v1::RenderGradReply>&)>;

  // All must outlive it.
  GroupRenderer(DatasetReader& dataset, const std::vector<const Group*>& groups, JobRenderer& pool)
      : dataset_(dataset), config_(dataset.manifest().config()), groups_(groups), pool_(pool) {}

  // In the order of the groups; nothing after the last.
  std::optional<RenderedGroup> next(const Wait& wait) {
    while (renders_.size() < ahead() && submit_next(wait)) {
    }
    if (renders_.empty()) return std::nullopt;
    Pending front = std::move(renders_.front());
    renders_.pop_front();
    RenderedGroup rendered{.group = front.group, .spp = front.spp};
    std::vector<v1::RenderGradReply> replies = replies_of(front, wait);
    for (const v1::RenderGradReply& reply : replies) {
      rendered.invalid_samples += reply.counters().invalid_samples();
      rendered.leaks += reply.counters().leaks();
    }
    rendered.replies = front.item.by_channel(std::move(replies));
    return rendered;
  }

 private:
  struct Pending {
    const Group* group = nullptr;
    ItemRenders item;  // the first
    std::vector<uint32_t> spp = {};
    std::vector<std::future<v1::RenderGradReply>> replies = {};
  };

  // Workers may join and leave.
  size_t ahead() const { return 2 * static_cast<size_t>(pool_.parallelism()) + 1; }

  static std::vector<v1::RenderGradReply> replies_of(Pending& pending, const Wait& wait) {
    std::vector<v1::RenderGradReply> replies;
    for (auto& reply : pending.replies) replies.push_back(wait(reply));
    return replies;
  }

  bool submit_next(const Wait& wait) {
    if (!config_.has_noise()) {
      if (next_ == groups_.size()) return false;
      const Group* group = groups_[next_++];
      Pending pending{.group = group, .item = {dataset_, *group->front()}};
      pending.spp.assign(pending.item.count(), config_.spp());
      submit(std::move(pending));
      return true;
    }
    for (; pilots_.size() < ahead() && next_ < groups_.size(); ++next_) {
      const Group* group = groups_[next_];
      Pending pilot{.group = group, .item = {dataset_, *group->front()}};
      for (size_t i = 0; i < pilot.item.count(); ++i) {
        pilot.replies.push_back(pool_.submit(pilot.item.pilot(i, config_.noise())));
      }
      pilots_.push_back(std::move(pilot));
    }
    if (pilots_.empty()) return false;
    Pending pilot = std::move(pilots_.front());
    pilots_.pop_front();
    for (const v1::RenderGradReply& reply : replies_of(pilot, wait)) {
      pilot.spp.push_back(spp_for(config_.noise(), relative_noise(reply)));
    }
    submit(std::move(pilot));
    return true;
  }

  // Its renders, whose samples are known.
  void submit(Pending pending) {
    pending.replies.clear();
    for (size_t r = 0; r < pending.item.count(); ++r) {
      RenderJob job = pending.item.job(r, pending.spp[r]);
      for (size_t i = 1; i < pending.group->size(); ++i) {
        job.request.add_albedos((*pending.group)[i]->material().albedo());
      }
      if (config_.derivatives()) ask_for_derivatives(job);
      pending.replies.push_back(pool_.submit(std::move(job)));
    }
    renders_.push_back(std::move(pending));
  }

  DatasetReader& dataset_;
  const v1::DatasetConfig& config_;
  const std::vector<const Group*>& groups_;
  JobRenderer& pool_;
  size_t next_ = 0;  // of the groups
  std::deque<Pending> pilots_, renders_;
};

}  // namespace

void require_same_config(const v1::Dataset& existing, const v1::DatasetConfig& wanted,
                         const fs::path& folder) {
  if (wanted.count() < existing.config().count()) {
    throw invalid_input(
        fmt::format("{} holds {} images, and {} are asked for; images can be added, not taken "
                    "away: choose another folder",
                    folder.string(), existing.config().count(), wanted.count()));
  }
  v1::DatasetConfig same_count = wanted;
  same_count.set_count(existing.config().count());
  const std::string differences = difference(existing.config(), same_count);
  if (!differences.empty()) throw another_dataset(folder, differences);
}

void ask_for_derivatives(RenderJob& job) {
  job.request.set_estimates(kDerivativeEstimates);
  for (const v1::Parameter parameter : {v1::SIGMA_T, v1::ALBEDO, v1::G}) {
    job.request.add_derivatives(parameter);
  }
}

DatasetProgress render_dataset(DatasetPlan plan, const fs::path& folder, JobRenderer& pool,
                               const std::function<void(const DatasetProgress&)>& report,
                               std::stop_token stop) {
  const FolderLock lock(folder, "itn dataset");
  set_up_folder(plan, folder, stop);
  plan = {};  // the reader has it
  for (const char* below : {"", "images", "shapes", "panoramas"}) {
    lock.remove_temporary_files(below);
  }
  DatasetReader dataset(folder);
  // Keep what is there.
  DatasetProgress progress;
  progress.total = static_cast<size_t>(dataset.manifest().items_size());
  const std::vector<Group> groups = groups_of(dataset.manifest());
  std::set<const v1::DatasetItem*> missing;
  std::vector<const Group*> waiting;
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
    if (!complete) waiting.push_back(&group);
  }
  progress.done = progress.kept;
  report(progress);
  // Render the rest.
  GroupRenderer renderer(dataset, waiting, pool);
  const auto wait = [&](std::future<v1::RenderGradReply>& reply) {
    v1::RenderGradReply done =
        with_progress_in_error(progress, [&] { return wait_for_render(reply, stop); });
    progress.paths += done.counters().paths();
    progress.dropped += dropped(done.counters());
    return done;
  };
  while (const auto rendered = renderer.next(wait)) {
    const Group& group = *rendered->group;
    for (size_t member = 0; member < group.size(); ++member) {
      if (missing.contains(group[member])) {
        const Image image = image_of(dataset, *rendered, member);
        with_progress_in_error(progress, [&] { write_exr(folder / group[member]->file(), image); });
        ++progress.done;
        report(progress);
      }
    }
  }
  return progress;
}

}  // namespace itn
