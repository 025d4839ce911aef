#include "client/experiment/tables.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace itn {
namespace {

using ::testing::HasSubstr;

// Three images of two shapes.
TestSet test_set() {
  return {.truth = {{40, 0.5, 0.2}, {100, 0.7, 0.4}, {220, 0.9, 0.6}},
          .shapes = {"a", "a", "b"},
          .other_noise = {0, 2},
          .rerendered = {0, 2},
          .refined = {}};
}

// Off by 10, .1 and .2 everywhere.
Candidate network(const std::string& name, double factor = 1) {
  Candidate candidate;
  candidate.name = name;
  for (const Material& m : test_set().truth) {
    candidate.as_trained.push_back(
        {m.sigma_t + 10 * factor, m.albedo - 0.1 * factor, m.g - 0.2 * factor});
  }
  for (const uint32_t i : test_set().other_noise) {
    const Material m = test_set().truth[i];
    candidate.other_noise.push_back({m.sigma_t + (i == 0 ? 20 : 40), m.albedo, m.g});
  }
  candidate.same_scene = {.relative_l2 = {0.1, 0.3}, .dissimilarity = {0.01, 0.02}};
  candidate.novel_scene = {.relative_l2 = {0.2, 0.6}, .dissimilarity = {0.03, 0.05}};
  return candidate;
}

Candidate constant() {
  Candidate candidate;
  candidate.name = "constant predictor";
  candidate.kind = Candidate::Kind::kBaseline;
  candidate.as_trained = {3, {120, 0.7, 0.4}};
  candidate.other_noise = {2, {120, 0.7, 0.4}};
  return candidate;
}

double value(const Table& table, const std::string& row, const std::string& column) {
  const auto r = std::ranges::find(table.rows, row, &Row::name);
  const auto c = std::ranges::find(table.columns, column, &Column::name);
  if (r == table.rows.end() || c == table.columns.end()) return NAN;
  const auto& cell = r->cells[static_cast<size_t>(c - table.columns.begin())];
  return cell ? cell->value : NAN;
}

TEST(Table1, HasRootMeanSquareErrors) {
  const std::vector<Candidate> candidates = {constant(), network("A")};
  const Table table = table_1(test_set(), candidates, false);
  EXPECT_NEAR(value(table, "A", "sigma_t"), 10, 1e-9);
  EXPECT_NEAR(value(table, "A", "albedo"), 0.1, 1e-9);
  EXPECT_NEAR(value(table, "A", "g"), 0.2, 1e-9);
  // 50 * .4 = 20, 110 * .6 = 66 and 230 * .8 = 184 scatter, of 20, 70 and 198.
  EXPECT_NEAR(value(table, "A", "sigma_s"), std::sqrt((0 + 16 + 196) / 3.0), 1e-9);
  EXPECT_NEAR(value(table, "A", "sigma_a"), std::sqrt((100 + 196 + 576) / 3.0), 1e-9);
  // (1 - 0) 20, (1 - .2) 66, (1 - .4) 184 of .8 20, .6 70, .4 198.
  EXPECT_NEAR(value(table, "A", "sigma_s'"),
              std::sqrt((16 + std::pow(52.8 - 42, 2) + std::pow(110.4 - 79.2, 2)) / 3), 1e-9);
  EXPECT_NEAR(value(table, "A", "image L2"), 0.2, 1e-9);
  EXPECT_NEAR(value(table, "A", "1 - MS-SSIM"), 0.015, 1e-9);
  // The standard deviation of each column's own truth; sigma_a is 20, 30, 22.
  EXPECT_NEAR(value(table, "constant predictor", "sigma_t"), std::sqrt((6400 + 400 + 10000) / 3.0),
              1e-9);
  EXPECT_NEAR(value(table, "constant predictor", "sigma_a"), std::sqrt((16 + 36 + 4) / 3.0), 1e-9);
  // What is published is marked, and only the three parameters are.
  EXPECT_EQ(value(table, "published: RN+naive", "sigma_t"), 90.8);
  EXPECT_TRUE(std::isnan(value(table, "published: RN+naive", "sigma_a")));
  EXPECT_TRUE(table.rows.back().is_published);
  EXPECT_FALSE(table.rows[1].is_published);
}

TEST(Table1, OfAnotherNoiseHasItsImagesAndPredictions) {
  const std::vector<Candidate> candidates = {constant(), network("A")};
  const Table table = table_1(test_set(), candidates, true);
  EXPECT_THAT(table.caption, HasSubstr("over 2 images of 2 shapes"));
  EXPECT_NEAR(value(table, "A", "sigma_t"), std::sqrt((400 + 1600) / 2.0), 1e-9);
  EXPECT_NEAR(value(table, "constant predictor", "sigma_t"), 90, 1e-9);  // of 40 and 220
  EXPECT_NEAR(value(table, "A", "albedo"), 0, 1e-9);
  EXPECT_EQ(table.columns.size(), 7U);
}

TEST(Gains, AreOverTheConstantAndTheFirstNetwork) {
  const std::vector<Candidate> candidates = {constant(), network("A"), network("B", 0.5)};
  const Table table = gain_table(test_set(), candidates);
  const double sigma_t = 10 / std::sqrt(16800 / 3.0), albedo = 0.1 / std::sqrt(0.08 / 3),
               g = 0.2 / std::sqrt(0.08 / 3);
  EXPECT_NEAR(value(table, "A", "sigma_t"), sigma_t, 1e-9);
  EXPECT_NEAR(value(table, "A", "mean"), (sigma_t + albedo + g) / 3, 1e-9);
  EXPECT_NEAR(value(table, "constant predictor", "mean"), 1, 1e-9);
  EXPECT_NEAR(value(table, "A", "over A"), 1, 1e-9);
  EXPECT_NEAR(value(table, "B", "over A"), 0.5, 1e-9);
  // Half of everything in each draw.
  EXPECT_NEAR(table.rows[2].cells.back()->high.value(), 0.5, 1e-9);
}

TEST(ThicknessTable, HasThirdsOfRisingSigmaT) {
  const std::vector<Candidate> candidates = {constant()};
  const Table table = thickness_table(test_set(), candidates);
  ASSERT_EQ(table.columns.size(), 9U);
  EXPECT_EQ(table.columns[0].name, "sigma_t of 40 to 40");
  EXPECT_NEAR(table.rows[0].cells[0]->value, 80, 1e-9);  // of the mean of all, 120
  EXPECT_NEAR(table.rows[0].cells[6]->value, 100, 1e-9);
}

TEST(Table2, HasTheNovelScene) {
  const std::vector<Candidate> candidates = {network("A")};
  const Table table = table_2(test_set(), candidates, "a cube");
  EXPECT_NEAR(value(table, "A", "image L2"), 0.4, 1e-9);
  EXPECT_NEAR(value(table, "A", "1 - MS-SSIM"), 0.04, 1e-9);
  EXPECT_THAT(table.caption, HasSubstr("a cube"));
}

TEST(Table3, HasErrorsByIteration) {
  TestSet test = test_set();
  test.refined = {0, 2};
  v1::AnalysisBySynthesis settings;
  for (const uint32_t i : {1U, 9U}) settings.add_iterations(i);
  settings.add_gauss_newton_iterations(1);
  Candidate a = network("A");
  for (const uint32_t i : test.refined) {
    v1::ExperimentRefinement& refinement = a.refinements.emplace_back();
    const auto add = [](v1::ExperimentRefinement::Iterate& iterate, const Material& m) {
      iterate.mutable_material()->set_sigma_t(m.sigma_t);
      iterate.mutable_material()->set_albedo(m.albedo);
      iterate.mutable_material()->set_g(m.g);
      iterate.set_cpu_seconds(2);
    };
    add(*refinement.add_adam(), a.as_trained[i]);
    add(*refinement.add_adam(), test.truth[i]);
    add(*refinement.add_gauss_newton(), test.truth[i]);
  }
  const std::vector<Candidate> candidates = {network("not refined"), a};
  const Table table = table_3(test, candidates, settings);
  ASSERT_EQ(table.rows.size(), 1U);
  // The error of the refined images alone: their distances from the mean of all, 120, .7 and .4.
  const double start = (10 / std::sqrt((6400 + 10000) / 2.0) + 0.1 / 0.2 + 0.2 / 0.2) / 3;
  EXPECT_NEAR(value(table, "A", "Adam 1"), start, 1e-6);
  EXPECT_NEAR(value(table, "A", "Adam 9"), 0, 1e-6);
  EXPECT_NEAR(value(table, "A", "Gauss-Newton 1"), 0, 1e-6);
  EXPECT_NEAR(value(table, "A", "Adam"), 2, 1e-9);
}

// What nobody knows has no cell: a network that is not trained, and one that shares no start.
TEST(TrainingTable, SaysWhichStepsWereKept) {
  v1::NetworkCost shared, own;
  shared.set_steps(1200);
  shared.set_kept_step(200);
  own.set_steps(600);
  own.set_kept_step(400);
  own.set_cpu_seconds(12.5);
  own.set_seconds(8);
  const std::vector<NetworkTraining> networks{
      {"a", shared, own}, {"b", std::nullopt, own}, {"c", shared, std::nullopt}};
  EXPECT_EQ(to_csv(training_table(networks)).substr(0, 20), "name,published,share");
  const Table table = training_table(networks);
  const auto values = [&](size_t row) {
    std::vector<double> numbers;
    for (const auto& cell : table.rows[row].cells) numbers.push_back(cell ? cell->value : -1);
    return numbers;
  };
  EXPECT_EQ(values(0), (std::vector<double>{1200, 200, 600, 400, 12.5, 8}));
  EXPECT_EQ(values(1), (std::vector<double>{-1, -1, 600, 400, 12.5, 8}));
  EXPECT_EQ(values(2), (std::vector<double>{1200, 200, -1, -1, -1, -1}));
}

TEST(Csv, QuotesWhatHasCommasAndLeavesOutWhatIsNot) {
  const Table table{
      .file = "t",
      .title = "",
      .caption = "",
      .columns = {{"x", "1/mm", 1}, {"y", "", 1}},
      .rows = {{.name = "a, \"b\"", .cells = {Cell{1.5, 1, 2}, std::nullopt}},
               {.name = "c", .is_published = true, .cells = {Cell{3, {}, {}}, Cell{4, {}, {}}}}}};
  EXPECT_EQ(to_csv(table),
            "name,published,x [1/mm],x [1/mm] low,x [1/mm] high,y,y low,y high\n"
            "\"a, \"\"b\"\"\",no,1.5,1,2,,,\n"
            "c,yes,3,,,4,,\n");
}

}  // namespace
}  // namespace itn
