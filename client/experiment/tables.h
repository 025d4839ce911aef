// The tables of an experiment, as numbers: from what networks said of the test, and how their
// images compare.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/training/shape_bootstrap.h"
#include "common/material.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// Names of candidates.
inline constexpr const char* kConstant = "constant predictor";
inline constexpr const char* kSimilarity = "similarity predictor";

// What a row of the tables is about.
struct Candidate {
  enum class Kind {
    kNetwork,
    kBaseline,  // has not looked at the images
    kTruth,     // the materials of the test themselves: what is left is noise of the renders
  };
  std::string name;
  Kind kind = Kind::kNetwork;
  std::vector<Material> as_trained;   // for each image of the test
  std::vector<Material> other_noise;  // for each image of TestSet::other_noise
  // Errors of each image that was rendered again, in its own scene and in the novel one.
  struct ImageErrors {
    std::vector<double> relative_l2, dissimilarity;
  };
  ImageErrors same_scene, novel_scene;
  // Refinements of each image that started at what this one says of it; none if there were none.
  std::vector<v1::ExperimentRefinement> refinements;
};

struct TestSet {
  std::vector<Material> truth;
  std::vector<std::string> shapes;    // of each image
  std::vector<uint32_t> other_noise;  // numbers of the images that were rendered with that, too
  std::vector<uint32_t> rerendered;   // and again with the predictions
  std::vector<uint32_t> refined;
};

struct Cell {
  double value = 0;
  std::optional<double> low, high;  // 95 % interval
};

struct Column {
  std::string name, unit;  // unit may be empty
  int decimals = 3;
  bool is_error = true;  // the least is the best
};

struct Row {
  std::string name;
  bool is_published = false;  // of a paper, on its own data
  bool is_baseline = false;
  std::vector<std::optional<Cell>> cells;  // as many as columns
};

struct Table {
  std::string file;  // without extension
  std::string title;
  std::string caption;  // what it is over, and how to read it
  std::vector<Column> columns;
  std::vector<Row> rows;
};

// Root-mean-square errors on the test with intervals over shapes, and how far images are.
// `other_noise`: of the images of the other noise.
Table table_1(const TestSet& whole, std::span<const Candidate> candidates, bool other_noise);

// Errors over those of the constant predictor, their mean, and that mean over the first network's.
Table gain_table(const TestSet& test, std::span<const Candidate> candidates);

// Root-mean-square errors by thirds of the test in sigma_t, that is in optical thickness.
Table thickness_table(const TestSet& test, std::span<const Candidate> candidates);

// How far images of the predictions are in a scene that none of them is from.
Table table_2(const TestSet& test, std::span<const Candidate> candidates, const std::string& scene);

// Analysis by synthesis from each of the candidates that were refined: errors over those of the
// constant predictor, mean of the three parameters, at iterations of Adam and, beside it, of
// Gauss-Newton.
Table table_3(const TestSet& test, std::span<const Candidate> candidates,
              const v1::AnalysisBySynthesis& settings);

// How a network was trained: the start that it shares with others, if any, and what it did by
// itself; absent where nobody knows.
struct NetworkTraining {
  std::string name;
  std::optional<v1::NetworkCost> shared, own;
};

// Steps, which of them was kept, and what those by itself took.
Table training_table(std::span<const NetworkTraining> networks);

// Every row with the names of the columns before; intervals in columns of their own; empty where
// there is nothing (RFC 4180).
std::string to_csv(const Table& table);

// The table as text, its columns in line.
std::string to_text(const Table& table);

}  // namespace itn
