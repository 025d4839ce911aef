// Predictions for people and for programs: a table, JSON, or CSV.
#pragma once

#include <memory>
#include <string>

#include "itn/v1/learning.pb.h"

namespace itn {

enum class TableFormat { kText, kJson, kCsv };

// To stdout, predictions as they come.
class PredictionPrinter {
 public:
  virtual ~PredictionPrinter() = default;
  virtual void print(const v1::Prediction& prediction) = 0;
  // Once, after the last.
  virtual void finish() {}
};

// kText: of several images each is named. kJson: itn.v1.Prediction, one a line. kCsv: a line with
// the names of the columns, then one for each channel; one without numbers for an image that could
// not be used.
std::unique_ptr<PredictionPrinter> prediction_printer(TableFormat format, bool several);

}  // namespace itn
