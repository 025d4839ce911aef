#include "client/experiment/refinements.h"

#include <algorithm>
#include <mutex>

#include <fmt/format.h>

#include "client/in_parallel.h"
#include "client/refine/refinement.h"
#include "client/scene/text_proto.h"
#include "client/training/evaluation.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

using Iterates = google::protobuf::RepeatedPtrField<v1::ExperimentRefinement::Iterate>;

fs::path file_of(const fs::path& folder, uint32_t image) {
  return folder / fmt::format("{:04}.textproto", image);
}

v1::ExperimentRefinement read_refinement(const fs::path& file) {
  v1::ExperimentRefinement refinement;
  parse_text_proto(read_file(file, "refinement"), file.string(), refinement);
  return refinement;
}

// Whether the file is there and tells of a refinement from this start.
bool is_done_from(const fs::path& file, const Material& start) {
  return fs::exists(file) && from_proto(read_refinement(file).start()) == start;
}

// The iterations that are told; where the refinement ended before, its last.
Iterates select_iterations(const std::vector<v1::RefineIteration>& trajectory,
                           const google::protobuf::RepeatedField<uint32_t>& iterations) {
  Iterates result;
  for (const uint32_t iteration : iterations) {
    const size_t count = std::min<size_t>(iteration, trajectory.size());
    const v1::RefineIteration& at = trajectory[count - 1];
    v1::ExperimentRefinement::Iterate& iterate = *result.Add();
    *iterate.mutable_material() = at.materials(0);
    iterate.set_loss(at.loss());
    double cpu_seconds = 0;
    for (size_t i = 0; i < count; ++i) cpu_seconds += trajectory[i].cpu_seconds();
    iterate.set_cpu_seconds(cpu_seconds);
  }
  return result;
}

Iterates refined(const v1::RefineSettings& settings, const Observation& observation,
                 const Material& start, const google::protobuf::RepeatedField<uint32_t>& iterations,
                 const Renderer& renderer) {
  Refinement refinement(settings, std::span(&observation, 1), {start});
  while (!refinement.finished()) refinement.step(renderer);
  return select_iterations(refinement.trajectory(), iterations);
}

}  // namespace

std::vector<uint32_t> refined_images(const v1::AnalysisBySynthesis& settings, size_t test_images) {
  return spread(settings.images(), test_images);
}

v1::ExperimentRefinements refine_images(const v1::AnalysisBySynthesis& settings,
                                        DatasetReader& dataset, const LabelledImages& test,
                                        std::span<const Material> starts, const fs::path& folder,
                                        JobRenderer& pool,
                                        const std::function<void(size_t, size_t)>& progress,
                                        std::stop_token stop) {
  fs::create_directories(folder);
  v1::RefineSettings adam;
  adam.set_method(v1::RefineSettings::ADAM);
  adam.set_spp(settings.spp());
  adam.set_learning_rate(settings.learning_rate());
  adam.set_max_iterations(*settings.iterations().rbegin());
  v1::RefineSettings gauss_newton;
  gauss_newton.set_spp(settings.spp());
  gauss_newton.set_max_spp(std::max(settings.max_spp(), settings.spp()));
  gauss_newton.set_max_iterations(*settings.gauss_newton_iterations().rbegin());
  const Renderer renderer = rendered_by(pool, stop);
  const std::vector<uint32_t> images = refined_images(settings, test.items.size());
  std::mutex mutex;
  size_t done = 0;
  progress(done, images.size());
  in_parallel(images.size(), stop, [&](size_t k) {
    const uint32_t i = images[k];
    if (const fs::path file = file_of(folder, i); !is_done_from(file, starts[i])) {
      Observation observation;
      {
        const std::lock_guard lock(mutex);  // of the dataset
        observation.scene = dataset.scene(*test.items[i]);
      }
      const DatasetImage image = test.read(i);
      observation.name = test.items[i]->file();
      observation.radiance = image.radiance;
      observation.mask = image.mask;
      observation.noise = image.standard_error;
      v1::ExperimentRefinement refinement;
      *refinement.mutable_start() = to_proto(starts[i]);
      *refinement.mutable_adam() =
          refined(with_defaults(adam), observation, starts[i], settings.iterations(), renderer);
      *refinement.mutable_gauss_newton() =
          refined(with_defaults(gauss_newton), observation, starts[i],
                  settings.gauss_newton_iterations(), renderer);
      write_file_atomically(file, to_text_proto(refinement));
    }
    const std::lock_guard lock(mutex);
    progress(++done, images.size());
  });
  v1::ExperimentRefinements refinements;
  for (const fs::path& file : refinement_files(settings, test.items.size(), folder)) {
    *refinements.add_images() = read_refinement(file);
  }
  return refinements;
}

std::vector<fs::path> refinement_files(const v1::AnalysisBySynthesis& settings, size_t test_images,
                                       const fs::path& folder) {
  std::vector<fs::path> files;
  for (const uint32_t i : refined_images(settings, test_images)) {
    files.push_back(file_of(folder, i));
  }
  return files;
}

}  // namespace itn
