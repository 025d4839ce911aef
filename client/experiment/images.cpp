#include "client/experiment/images.h"

#include <algorithm>
#include <deque>
#include <future>
#include <numeric>
#include <utility>

#include <fmt/format.h>

#include "client/dataset/dataset_render.h"
#include "client/dataset/item_scene.h"
#include "client/image/image.h"
#include "client/image/ms_ssim.h"
#include "client/render/job_renderer.h"
#include "client/training/evaluation.h"
#include "common/geometry/shapes.h"
#include "common/random.h"
#include "common/scene/material_proto.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// Branches of an item's seed, beside those of its image (dataset_render.cpp).
constexpr uint64_t kReferenceBranch = 11, kComparedBranch = 12;

const ImageProgress kNobody = [](size_t, size_t) {};  // is told

// Renders jobs, enough of them under way that no worker is idle; in order.
void render_all(size_t count, const std::function<RenderJob(size_t)>& job, JobRenderer& pool,
                const std::stop_token& stop,
                const std::function<void(size_t, const v1::RenderGradReply&)>& take) {
  std::deque<std::future<v1::RenderGradReply>> pending;
  size_t next = 0;
  for (size_t i = 0; i < count; ++i) {
    const size_t ahead = 2 * static_cast<size_t>(pool.parallelism());
    while (next < count && pending.size() < ahead) pending.push_back(pool.submit(job(next++)));
    const v1::RenderGradReply reply = wait_for_render(pending.front(), stop);
    pending.pop_front();
    take(i, reply);
  }
}

const char* name_of(ExperimentScene scene) {
  return scene == ExperimentScene::kSame ? "same" : "novel";
}

using ImagePlace = std::pair<ExperimentScene, size_t>;  // the number is that of a chosen image

// The images, in both scenes, whose files are not there.
template <typename FileOf>
std::vector<ImagePlace> missing_of(std::span<const size_t> images, const FileOf& file_of) {
  std::vector<ImagePlace> missing;
  for (const ExperimentScene scene : kExperimentScenes) {
    for (const size_t k : images) {
      if (!fs::exists(file_of(scene, k))) missing.emplace_back(scene, k);
    }
  }
  return missing;
}

void write_image(const fs::path& path, int side, std::vector<float> radiance,
                 std::vector<float> mask = {}) {
  Image image;
  image.width = image.height = side;
  image.channels["Y"] = std::move(radiance);
  if (!mask.empty()) image.channels["mask.Y"] = std::move(mask);
  write_exr(path, image);
}

}  // namespace

ExperimentImages::ExperimentImages(const v1::Rerendering& settings, DatasetReader& dataset,
                                   const LabelledImages& test, fs::path references,
                                   fs::path pictures)
    : settings_(settings),
      dataset_(dataset),
      test_(test),
      references_(std::move(references)),
      pictures_(std::move(pictures)),
      chosen_(spread(settings.images(), test.items.size())) {
  for (const uint32_t k : spread(settings.shown(), chosen_.size())) shown_.push_back(k);
}

fs::path ExperimentImages::reference_file(ExperimentScene scene, size_t k) const {
  return references_ / fmt::format("{}_{:04}.exr", name_of(scene), chosen_[k]);
}

fs::path ExperimentImages::picture_file(const std::string& name, ExperimentScene scene,
                                        size_t k) const {
  return pictures_ / name / fmt::format("{}_{:04}.exr", name_of(scene), chosen_[k]);
}

std::shared_ptr<const SerializedScene> ExperimentImages::scene_of(ExperimentScene scene, size_t k) {
  const v1::DatasetItem& item = *test_.items[chosen_[k]];
  if (scene == ExperimentScene::kSame) return dataset_.scene(item);
  if (!novel_) {
    v1::DatasetItem novel = *test_.items.front();
    novel.clear_rotation();
    v1::SunSky& sun = *novel.mutable_light()->mutable_sun_sky();
    sun.set_sun_azimuth_degrees(static_cast<float>(settings_.novel_azimuth_degrees()));
    v1::Mesh mesh;
    set_triangles(mesh, make_shape(settings_.novel_shape()));
    novel_ =
        serialize(itn::scene_of(novel, mesh.triangles(), static_cast<uint32_t>(test_.resolution)));
  }
  return novel_;
}

RenderJob ExperimentImages::job(ExperimentScene scene, size_t k, const Material& material,
                                uint32_t spp, uint64_t branch) {
  v1::DatasetItem item = *test_.items[chosen_[k]];
  *item.mutable_material() = to_proto(material);
  item.set_seed(derive_seed(item.seed(), {branch, static_cast<uint64_t>(scene)}));
  return render_job(scene_of(scene, k), item, spp);
}

void ExperimentImages::render_references(JobRenderer& pool, const ImageProgress& progress,
                                         std::stop_token stop) {
  std::vector<size_t> all(chosen_.size());
  std::iota(all.begin(), all.end(), size_t{0});
  render_references(all, pool, progress, stop);
}

void ExperimentImages::render_references(std::span<const size_t> images, JobRenderer& pool,
                                         const ImageProgress& progress,
                                         const std::stop_token& stop) {
  fs::create_directories(references_);
  const std::vector<ImagePlace> missing =
      missing_of(images, [&](ExperimentScene scene, size_t k) { return reference_file(scene, k); });
  const size_t total = 2 * images.size();
  size_t done = total - missing.size();
  progress(done, total);
  render_all(
      missing.size(),
      [&](size_t i) {
        const auto [scene, k] = missing[i];
        return job(scene, k, test_.truth[chosen_[k]], kReferenceSamples * settings_.spp(),
                   kReferenceBranch);
      },
      pool, stop,
      [&](size_t i, const v1::RenderGradReply& reply) {
        const auto [scene, k] = missing[i];
        write_image(reference_file(scene, k), resolution(),
                    from_bytes<float>(reply.estimates(0).radiance()),
                    from_bytes<float>(reply.mask()));
        progress(++done, total);
      });
}

v1::ExperimentImageErrors ExperimentImages::compare(const std::vector<Material>& materials,
                                                    JobRenderer& pool,
                                                    const ImageProgress& progress,
                                                    const std::stop_token& stop) {
  render_references(pool, kNobody, stop);  // those that are gone
  v1::ExperimentImageErrors result;
  const size_t count = chosen_.size(), total = 2 * count;
  const auto place = [&](size_t i) { return std::pair(kExperimentScenes[i / count], i % count); };
  progress(0, total);
  render_all(
      total,
      [&](size_t i) {
        const auto [scene, k] = place(i);
        return job(scene, k, materials[chosen_[k]], settings_.spp(), kComparedBranch);
      },
      pool, stop,
      [&](size_t i, const v1::RenderGradReply& reply) {
        const auto [scene, k] = place(i);
        const std::vector<float> rendered = from_bytes<float>(reply.estimates(0).radiance());
        const std::vector<float> truth = reference(scene, k);
        v1::ExperimentImageErrors::Errors& errors =
            scene == ExperimentScene::kSame ? *result.add_same_scene() : *result.add_novel_scene();
        errors.set_relative_l2(relative_image_error(truth, rendered, mask(scene, k)));
        errors.set_dissimilarity(1 - ms_ssim(resolution(), truth, rendered));
        progress(i + 1, total);
      });
  return result;
}

void ExperimentImages::render_pictures(const std::string& name,
                                       const std::vector<Material>& materials, JobRenderer& pool,
                                       const std::stop_token& stop) {
  render_references(shown_, pool, kNobody, stop);
  fs::create_directories(pictures_ / name);
  const std::vector<ImagePlace> missing = missing_of(
      shown_, [&](ExperimentScene scene, size_t k) { return picture_file(name, scene, k); });
  render_all(
      missing.size(),
      [&](size_t i) {
        const auto [scene, k] = missing[i];
        return job(scene, k, materials[chosen_[k]], settings_.spp(), kComparedBranch);
      },
      pool, stop,
      [&](size_t i, const v1::RenderGradReply& reply) {
        const auto [scene, k] = missing[i];
        write_image(picture_file(name, scene, k), resolution(),
                    from_bytes<float>(reply.estimates(0).radiance()));
      });
}

std::vector<float> ExperimentImages::reference(ExperimentScene scene, size_t k) const {
  return read_exr(reference_file(scene, k)).channel("Y");
}

std::vector<float> ExperimentImages::mask(ExperimentScene scene, size_t k) const {
  return read_exr(reference_file(scene, k)).channel("mask.Y");
}

std::vector<float> ExperimentImages::picture(const std::string& name, ExperimentScene scene,
                                             size_t k) const {
  return read_exr(picture_file(name, scene, k)).channel("Y");
}

}  // namespace itn
