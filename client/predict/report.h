// An answer as a page for people: one HTML file that needs nothing else.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/exports/exports.h"
#include "client/panels.h"
#include "client/predict/swatches.h"
#include "itn/v1/dataset.pb.h"
#include "itn/v1/learning.pb.h"

namespace itn {

struct ReportedPhotograph {
  v1::Prediction prediction;  // of this one alone
  PanelRow panels;            // network_view_panels(), and rerendered_panels() if there is a scene
};

struct Report {
  v1::Prediction prediction;  // with channels; of several photographs what they say together
  std::vector<ReportedPhotograph> photographs;
  std::vector<Swatch> swatches;
  // What the model can answer, for an object of 1 mm; absent if that is not known.
  std::optional<v1::MaterialRange> range;
  ExportOptions exports;  // size and provenance are the prediction's
};

// Images are in the page; it loads nothing. Text from elsewhere (names, messages) is escaped.
std::string report_page(const Report& report);

}  // namespace itn
