// Predictions put into the renderer again: how far their images are from those of the truth.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/render/job_renderer.h"
#include "client/training/training_set.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// The scenes that materials are rendered in.
enum class ExperimentScene {
  kSame,   // that of the test's image
  kNovel,  // one that is the same for all (Rerendering in experiment.proto)
};
inline constexpr ExperimentScene kExperimentScenes[] = {ExperimentScene::kSame,
                                                        ExperimentScene::kNovel};

// Samples of a reference over those of the images that are compared with it: half of their noise.
inline constexpr uint32_t kReferenceSamples = 4;

// What to tell while images are rendered; called with how many of how many are done.
using ImageProgress = std::function<void(size_t done, size_t total)>;

// Images of the test that are rendered again, and their references, of the truth.
class ExperimentImages {
 public:
  // `references`, `pictures`: the folders where they are. `test` and dataset must outlive it.
  ExperimentImages(const v1::Rerendering& settings, DatasetReader& dataset,
                   const LabelledImages& test, std::filesystem::path references,
                   std::filesystem::path pictures);

  // Numbers of the test's images, evenly spread.
  const std::vector<uint32_t>& chosen() const { return chosen_; }
  // Numbers of the images that are shown in pictures: the first of an even spread.
  const std::vector<size_t>& shown() const { return shown_; }
  int resolution() const { return test_.resolution; }

  // Renders the references that are not there, of all chosen images.
  void render_references(JobRenderer& pool, const ImageProgress& progress, std::stop_token stop);

  // Renders a material for each image of the test that is chosen, and compares them with the
  // references, which it renders where they are gone. The random numbers are the same whatever the
  // materials.
  v1::ExperimentImageErrors compare(const std::vector<Material>& materials, JobRenderer& pool,
                                    const ImageProgress& progress, const std::stop_token& stop);

  // Renders the pictures that are not there, of each shown image in both scenes, into the folder
  // `name` of pictures, and their references. They are the images that compare() sees.
  void render_pictures(const std::string& name, const std::vector<Material>& materials,
                       JobRenderer& pool, const std::stop_token& stop);

  // The reference render of the chosen image number `k`. Throws Error (kIo) if it has not been
  // rendered.
  std::vector<float> reference(ExperimentScene scene, size_t k) const;
  // One that render_pictures() made.
  std::vector<float> picture(const std::string& name, ExperimentScene scene, size_t k) const;

 private:
  std::filesystem::path reference_file(ExperimentScene scene, size_t k) const;
  std::filesystem::path picture_file(const std::string& name, ExperimentScene scene,
                                     size_t k) const;
  void render_references(std::span<const size_t> images, JobRenderer& pool,
                         const ImageProgress& progress, const std::stop_token& stop);
  // The job that renders the chosen image number `k` with a material in the place of its own.
  RenderJob job(ExperimentScene scene, size_t k, const Material& material, uint32_t spp,
                uint64_t branch);
  std::shared_ptr<const SerializedScene> scene_of(ExperimentScene scene, size_t k);
  std::vector<float> mask(ExperimentScene scene, size_t k) const;

  v1::Rerendering settings_;
  DatasetReader& dataset_;
  const LabelledImages& test_;
  std::filesystem::path references_, pictures_;
  std::vector<uint32_t> chosen_;
  std::vector<size_t> shown_;
  std::shared_ptr<const SerializedScene> novel_;
};

}  // namespace itn
