#include "client/experiment/report.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <string>
#include <vector>

#include "common/files/read_file.h"
#include "tests/client/experiment/experiment_fixture.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

void no_listener(size_t, size_t) {}

// A report of two networks: one that is right, one that is wrong. Neither was trained.
class ReportTest : public SmallExperiment {
 protected:
  static void SetUpTestSuite() {
    SmallExperiment::SetUpTestSuite();
    images_.emplace(images("images"));
    images_->render_references(*pool_, no_listener, {});
    render_dataset(colour_plan(test_plan(), std::vector<uint32_t>{0, 1}), files_->path("colours"),
                   *pool_, [](const DatasetProgress&) {});
    colours_.emplace(files_->path("colours"));
    for (const v1::ExperimentNetwork& network : experiment_.networks()) {
      const std::string file = file_name_of(network.name());
      images_->render_pictures(file, materials_of(network.name()), *pool_, {});
      render_colours(*colours_, std::vector<Material>(6, Material{80, 0.6, 0.3}), 4,
                     files_->path("images_pictures"), file, *pool_, {});
    }
  }
  static void TearDownTestSuite() {
    colours_.reset();
    images_.reset();
    SmallExperiment::TearDownTestSuite();
  }

  static DatasetPlan test_plan() {
    const v1::DatasetConfig& config = experiment_.dataset();
    DatasetPlan plan = plan_dataset(config, shape_set(config.shapes()).shapes);
    plan.manifest.clear_items();
    for (const v1::DatasetItem* item : test_.items) *plan.manifest.add_items() = *item;
    return plan;
  }
  static std::vector<Material> materials_of(const std::string& network) {
    return network == "RN+naive" ? std::vector<Material>(test_.truth.size(), {30, 0.2, 0})
                                 : test_.truth;
  }

  ReportTest() {
    set_.truth = test_.truth;
    for (const v1::DatasetItem* item : test_.items) set_.shapes.push_back(item->shape());
    for (const v1::ExperimentNetwork& network : experiment_.networks()) {
      Candidate& candidate = candidates_.emplace_back();
      candidate.name = network.name();
      candidate.as_trained = materials_of(network.name());
    }
    tables_ = {{.file = "t",
                .title = "Errors & more",
                .caption = "A caption.",
                .columns = {{"sigma_t", "1/mm", 1}, {"spread", "", 1, false}},
                .rows = {{.name = "constant", .is_baseline = true, .cells = cells(1, 1)},
                         {.name = "RN+naive", .cells = cells(5, 5)},
                         {.name = "ITN+naive", .cells = cells(3, 3)},
                         {.name = "theirs", .is_published = true, .cells = cells(2, 2)}}}};
  }

  static std::vector<std::optional<Cell>> cells(double a, double b) {
    return {Cell{a, a - 0.5, a + 0.5}, Cell{b, {}, {}}};
  }
  ReportedNetwork& add_network(const std::string& name, const std::string& metrics) {
    ReportedNetwork network;
    network.name = name;
    network.metrics = files_->write(file_name_of(name) + ".jsonl", metrics);
    return networks_.emplace_back(network);
  }
  std::string page() const {
    const std::filesystem::path file = write_report({.experiment = experiment_,
                                                     .tables = tables_,
                                                     .test = set_,
                                                     .candidates = candidates_,
                                                     .networks = networks_,
                                                     .images = *images_,
                                                     .colours = *colours_,
                                                     .pictures = files_->path("images_pictures"),
                                                     .rate = rate_,
                                                     .stages = stages_},
                                                    folder_.path());
    return read_file(file, "report");
  }
  bool has_picture(const std::string& name) const {
    return std::filesystem::file_size(folder_.path("report/" + name)) > 500;
  }

  static inline std::optional<ExperimentImages> images_;
  static inline std::optional<DatasetReader> colours_;
  const testing::TemporaryFolder folder_;
  TestSet set_;
  std::vector<Candidate> candidates_;
  std::vector<Table> tables_;
  std::vector<ReportedNetwork> networks_;
  v1::RateChoice rate_;
  std::vector<v1::StageRecord> stages_;
};

size_t count(const std::string& text, const std::string& part) {
  size_t n = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
  return n;
}

TEST_F(ReportTest, MarksTheBestNetworkOfAColumnOfErrors) {
  const std::string text = page();
  EXPECT_THAT(text, HasSubstr("## Errors & more"));
  EXPECT_THAT(text, HasSubstr("| ITN+naive | **3.0** (2.5-3.5) | 3.0 |"));
  // Not what is no network, nor where less is not better.
  EXPECT_EQ(count(text, " **"), 1U);
  EXPECT_THAT(text, HasSubstr("Published: Che et al."));
  EXPECT_THAT(text, HasSubstr("**These numbers mean nothing**"));  // of 8 steps
}

TEST_F(ReportTest, MarksNoneWhereIntervalsOverlap) {
  tables_[0].rows[1].cells = cells(3.4, 5);
  EXPECT_THAT(page(), HasSubstr("| ITN+naive | 3.0 (2.5-3.5) | 3.0 |"));
  tables_[0].rows[2].cells[0] = Cell{3, 3, 3};  // of one shape
  EXPECT_THAT(page(), HasSubstr("| 3.0 (-) | 3.0 |"));
}

TEST_F(ReportTest, ShowsTruthAndNetworksInBothScenesAndInColour) {
  add_network("RN+naive", "");
  add_network("ITN+naive", "");
  const std::string text = page();
  EXPECT_THAT(text, HasSubstr("| truth | RN+naive | ITN+naive |"));
  EXPECT_THAT(text, HasSubstr(" | 30, 0.20, 0.00 | "));
  for (const char* name : {"scenes.png", "novel.png", "colours.png"}) {
    EXPECT_THAT(text, HasSubstr("](report/" + std::string(name) + ")"));
    EXPECT_TRUE(has_picture(name)) << name;
  }
}

TEST_F(ReportTest, DrawsTheCurvesOfWhatTrainingsLogged) {
  add_network(
      "RN+naive",
      "{\"step\":1,\"regressionLoss\":2}\nnot a line\n"
      "{\"step\":2,\"regressionLoss\":1,\"validation\":{\"sigmaT\":1,\"albedo\":1,\"g\":1}}\n");
  const std::string text = page();
  EXPECT_THAT(text, HasSubstr("![Training](report/training.png)"));
  EXPECT_TRUE(has_picture("training.png"));
}

TEST_F(ReportTest, CountsTheTruthsInTheStatedIntervals) {
  ReportedNetwork& network = add_network("ITN+naive", "");
  EXPECT_THAT(page(), HasSubstr("they answer points"));
  constexpr double kHalf = 0.01;  // of an interval
  v1::ExperimentPredictions::Estimates& estimates = *network.predictions.mutable_as_trained();
  for (size_t i = 0; i < test_.truth.size(); ++i) {
    const Material& truth = test_.truth[i];
    const auto add = [](double low, double high, auto& lows, auto& highs) {
      lows.Add(static_cast<float>(low));
      highs.Add(static_cast<float>(high));
    };
    const double sigma_t = truth.sigma_t + (i % 2 == 0 ? 0 : 1), g = truth.g + 1;
    add(sigma_t - kHalf, sigma_t + kHalf, *estimates.mutable_sigma_t_low(),
        *estimates.mutable_sigma_t_high());
    add(truth.albedo - kHalf, truth.albedo + kHalf, *estimates.mutable_albedo_low(),
        *estimates.mutable_albedo_high());
    add(g - kHalf, g + kHalf, *estimates.mutable_g_low(), *estimates.mutable_g_high());
  }
  EXPECT_THAT(page(), HasSubstr("| 50.0 % | 100.0 % | 0.0 % |"));
}

TEST_F(ReportTest, SaysWhatItTook) {
  add_network("RN+naive", "");
  v1::RateChoice::Trial& trial = *rate_.add_trials();
  trial.set_rate(0.5);
  rate_.set_rate(0.001);
  v1::StageRecord& stage = stages_.emplace_back();
  stage.set_name("dataset");
  stage.set_seconds(90);
  stage.set_cpu_seconds(3.25);
  const std::string text = page();
  EXPECT_THAT(text, HasSubstr("0.5 (diverged)"));
  EXPECT_THAT(text, HasSubstr("| 1:30 | 3.2 s |"));
  EXPECT_THAT(text, HasSubstr("shared_steps: 10"));  // the experiment file
}

TEST_F(ReportTest, DrawsRefinements) {
  EXPECT_THAT(page(), Not(HasSubstr("Refinement, iteration by iteration")));
  tables_.push_back({.file = "table_3",
                     .title = "Table 3",
                     .caption = "",
                     .columns = {5, Column{"Adam", "", 2}},
                     .rows = {{.name = "ITN+naive",
                               .cells = {Cell{1, {}, {}}, Cell{0.5, {}, {}}, Cell{1, {}, {}},
                                         Cell{0.3, {}, {}}, Cell{0.1, {}, {}}}}}});
  EXPECT_THAT(page(), HasSubstr("Refinement, iteration by iteration"));
  EXPECT_TRUE(has_picture("refinement.png"));
}

}  // namespace
}  // namespace itn
