// What the tests of datasets have in common.
#pragma once

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "client/dataset/dataset_render.h"
#include "common/error.h"
#include "common/geometry/shapes.h"

namespace itn {

inline std::vector<Shape> few_shapes() {
  std::vector<Shape> shapes;
  for (const ShapeInfo& info : builtin_shapes().first(5)) {
    shapes.push_back(describe_shape(std::string(info.name), make_shape(info.name)));
  }
  return shapes;
}

inline v1::DatasetConfig small_config() {
  v1::DatasetConfig config = paper_config(16);
  config.set_validation_fraction(0);
  config.set_spp(2);
  config.set_count(8);
  config.set_seed(3);
  return config;
}

inline void expect_error(ErrorKind kind, const std::string& message,
                         const std::function<void()>& action) {
  try {
    action();
    ADD_FAILURE() << "no error; expected: " << message;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind);
    EXPECT_THAT(error.what(), ::testing::HasSubstr(message));
  }
}

class DatasetFolder : public ::testing::Test {
 protected:
  DatasetFolder() { std::filesystem::remove_all(folder_); }
  ~DatasetFolder() override { std::filesystem::remove_all(folder_); }

  DatasetProgress render(const DatasetPlan& plan, size_t stop_after = SIZE_MAX) const {
    RenderPool pool({});
    std::stop_source stop;
    return render_dataset(
        plan, folder_, pool,
        [&](const DatasetProgress& p) {
          if (p.done - p.kept >= stop_after) stop.request_stop();
        },
        stop.get_token());
  }

  std::map<std::string, std::string> files() const {
    std::map<std::string, std::string> result;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_)) {
      if (entry.is_regular_file()) {
        std::ostringstream content;
        content << std::ifstream(entry.path(), std::ios::binary).rdbuf();
        result[std::filesystem::relative(entry.path(), folder_)] = content.str();
      }
    }
    return result;
  }

  std::filesystem::path folder_ =
      std::filesystem::path(::testing::TempDir()) /
      (std::string("dataset-") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
  DatasetPlan plan_ = plan_dataset(small_config(), few_shapes());
};

}  // namespace itn
