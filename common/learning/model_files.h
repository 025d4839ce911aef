// Trained models that come with itn: files NAME.itn in a folder, each with a card NAME.md beside it
// that says what it was trained for.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace itn {

// Those that predict where no other is named, in any light, and from radiance on any scale: of a
// photograph in colour, and of one that has one channel. And the one for photographs in colour
// whose radiance is on a known scale.
inline constexpr const char* kDefaultModel = "real";
inline constexpr const char* kDefaultGrayModel = "any";
inline constexpr const char* kScaleModel = "card";

struct ShippedModel {
  std::string name;
  std::filesystem::path file;
  std::string title;  // the card's first line, without "#"; empty if there is no card
};

// $ITN_MODELS, or ../share/itn/models as seen from the program, where building and installing put
// them. It may not exist.
std::filesystem::path models_folder();

// The models in models_folder(), by name.
std::vector<ShippedModel> shipped_models();

// The first line, without "#", of the card beside a model's file; empty if there is none.
std::string card_title(const std::filesystem::path& model);

// What `model` stands for: a checkpoint file or the folder of a run if there is one at this path;
// the shipped model of this name; of an empty string, the one called `by_default`. Throws Error
// (kIo) that says where it was looked for and which models there are.
std::filesystem::path find_model(const std::string& model,
                                 const std::string& by_default = kDefaultModel);

}  // namespace itn
