// A refinement in a folder, or without one: how it goes on, and what it leaves behind.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/refine/refinement.h"

namespace itn {

struct RefineRun {
  // The folder of the state from which a run that was stopped goes on: state.itn, and
  // trajectory.jsonl (a RefineIteration as JSON a line), both replaced as a whole after each
  // iteration. Empty: nowhere. Whoever calls has locked it (FolderLock).
  std::filesystem::path folder;
  // What the starts come from, in words: part of what makes a run the same.
  std::string origin;
  // Seconds that went by before a new run, which are part of its time limit. A run that goes on has
  // counted them.
  double seconds_before = 0;
  // Starts of a new run.
  std::function<std::vector<Material>()> starts;
  // Called after each iteration with how many are done, those of a run that goes on among them;
  // optional.
  std::function<void(const v1::RefineIteration&, size_t done)> report;
};

// Until it is finished, from where the run in the folder was stopped if there is one. A run that
// ended by a limit (iterations, time) goes on if that is raised. Throws Error (invalid input) if
// the folder's run is one of other images, scenes or settings, and says what differs; what
// `renderer` throws, the state then being that after the last iteration.
Refinement refine(const v1::RefineSettings& settings, std::span<const Observation> observations,
                  const Renderer& renderer, const RefineRun& run);

inline constexpr const char* kRefineStateFile = "state.itn";
inline constexpr const char* kRefineResultFile = "result.json";  // in the folder of a run

// Folders of what is of one colour, in that of a run of three.
inline constexpr std::array<const char*, 3> kRgb{"R", "G", "B"};

// Writes result.json (v1::RefineResult), of several colours in a folder for each (kRgb); and
// picture.png: a row for each image and colour of target, fit and difference on the object, as by
// compared() of client/panels.h. `fits`: renders of the answer, times its exposure. Throws Error
// (kIo).
void write_outcome(const std::filesystem::path& folder, std::span<const v1::RefineResult> results,
                   std::span<const Observation> observations, std::span<const Render> fits,
                   double exposure);

// For people: the numbers with their intervals, how it ended, and the remarks.
std::string to_text(const v1::RefineResult& result);
// A table with a column for each of red, green and blue, or for the luminance.
std::string to_table(std::span<const v1::RefineResult> results);

}  // namespace itn
