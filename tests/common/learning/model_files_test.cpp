#include "common/learning/model_files.h"

#include <gmock/gmock.h>

#include <cstdlib>
#include <filesystem>

#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using testing::expect_error;

class ModelFiles : public ::testing::Test {
 protected:
  ModelFiles() { ::setenv("ITN_MODELS", folder_.path("models").c_str(), 1); }
  ~ModelFiles() override { ::unsetenv("ITN_MODELS"); }

  void ship(const std::string& name, const std::string& card) const {
    fs::create_directories(folder_.path("models"));
    folder_.write("models/" + name + ".itn", "weights");
    if (!card.empty()) folder_.write("models/" + name + ".md", card);
  }

  testing::TemporaryFolder folder_;
};

TEST_F(ModelFiles, AreListedByNameWithTheFirstLineOfTheirCards) {
  EXPECT_TRUE(shipped_models().empty());
  ship("studio", "# For soft boxes\n\nTrained with ...");
  ship("outdoor", "# Sun and sky");
  ship("bare", "");
  folder_.write("models/README.md", "# No model");
  const std::vector<ShippedModel> models = shipped_models();
  ASSERT_EQ(models.size(), 3);
  EXPECT_EQ(models[0].name, "bare");
  EXPECT_EQ(models[0].title, "");
  EXPECT_EQ(models[1].name, "outdoor");
  EXPECT_EQ(models[1].title, "Sun and sky");
  EXPECT_EQ(models[2].title, "For soft boxes");
  EXPECT_EQ(models[2].file, folder_.path("models/studio.itn"));
}

TEST_F(ModelFiles, AreFoundByNameAndByDefault) {
  ship(kDefaultModel, "");
  ship("studio", "");
  EXPECT_EQ(find_model("studio"), folder_.path("models/studio.itn"));
  EXPECT_EQ(find_model(""), folder_.path("models/real.itn"));
}

// Whatever it will be found to be.
TEST_F(ModelFiles, AreNotLookedForWhereAPathIsNamed) {
  ship("studio", "");
  folder_.write("studio", "a checkpoint");
  EXPECT_EQ(find_model(folder_.path("studio")), folder_.path("studio"));
  EXPECT_EQ(find_model(folder_.path("run")), folder_.path("run"));
  EXPECT_EQ(find_model("lamp.itn"), "lamp.itn");
  const std::string shipped = folder_.path("models/studio.itn");
  EXPECT_EQ(find_model(shipped), shipped);
}

TEST_F(ModelFiles, AreOfferedByNameWhereAFileOfThatNameIsMissing) {
  ship("studio", "");
  for (const std::string& file : {std::string("studio.itn"), folder_.path("no/studio.itn")}) {
    expect_error(ErrorKind::kIo,
                 {"cannot read the checkpoint " + file + ": No such file", "--model studio"},
                 [&] { find_model(file); });
  }
}

TEST_F(ModelFiles, ThatAreMissingAreSaidTo) {
  expect_error(ErrorKind::kIo,
               {"no model is named", "real, is missing",
                "there is no model in " + folder_.path("models"), "--model FILE"},
               [] { find_model(""); });
  ship("studio", "");
  expect_error(ErrorKind::kIo, {"outdoors is neither", "there are studio"},
               [] { find_model("outdoors"); });
}

// Models lie as built or as installed: bin/PROGRAM, share/itn/models.
TEST(ModelsFolder, IsBesideTheProgram) {
  EXPECT_EQ(models_folder().filename(), "models");
  EXPECT_EQ(models_folder().parent_path().parent_path().parent_path(),
            fs::read_symlink("/proc/self/exe").parent_path().parent_path());
}

}  // namespace
}  // namespace itn
