// Optical parameters from photographs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/exports/exports.h"
#include "client/predict/photograph_input.h"
#include "client/rpc/client_security.h"

namespace itn {

struct PredictOptions {
  std::vector<std::string> images;  // files and folders
  PhotographOptions photographs;
  bool one_material = false;
  bool matt = false;
  std::optional<std::string> model;
  std::string predictor;
  ClientSecurity security;
  std::string version;  // of the predictor's model; empty: its newest
  double timeout = 60;  // in seconds
  std::string format = "text";
  std::string picture;  // a PNG file
  std::string report;   // an HTML file
  std::string scene;    // to render with the answer, for both
  uint32_t spp = 64;    // of renders for them
  std::string output;   // of exports: a file, or a folder for several; empty: standard output
  ExportOptions exports;
};

void run_predict(const PredictOptions& options);

}  // namespace itn
