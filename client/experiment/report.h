// An experiment for people: a Markdown page, and pictures in a folder beside it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/experiment/images.h"
#include "client/experiment/tables.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

struct ReportedNetwork {
  std::string name;
  std::filesystem::path metrics;         // metrics.jsonl of its run
  std::filesystem::path shared_metrics;  // and of the one that it goes on from; may be empty
  v1::ExperimentPredictions predictions;
};

struct ExperimentReport {
  const v1::Experiment& experiment;
  const std::vector<Table>& tables;
  const TestSet& test;
  const std::vector<Candidate>& candidates;
  std::vector<ReportedNetwork> networks;
  const ExperimentImages& images;
  const DatasetReader& colours;    // of colour_plan()
  std::filesystem::path pictures;  // where render_colours() wrote
  v1::RateChoice rate;
  std::vector<v1::StageRecord> stages;
};

// Writes `folder`/report.md, whose path it returns, and pictures into `folder`/report. Throws Error
// (kIo).
std::filesystem::path write_report(const ExperimentReport& report,
                                   const std::filesystem::path& folder);

}  // namespace itn
