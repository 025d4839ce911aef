#include "client/predict/answer_warnings.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <utility>

namespace itn {
namespace {

std::string sentence(std::string text) {
  if (text.empty()) return text;
  text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text.back() == '.' ? text : text + '.';
}

}  // namespace

std::string in_words(v1::MaterialBound bound) {
  switch (bound) {
    case v1::SIGMA_T_MIN: return "the least sigma_t";
    case v1::SIGMA_T_MAX: return "the greatest sigma_t";
    case v1::ALBEDO_MIN: return "the least albedo";
    case v1::ALBEDO_MAX: return "the greatest albedo";
    case v1::G_MIN: return "the least g";
    case v1::G_MAX: return "the greatest g";
    default: return "an end";
  }
}

bool in_all_channels(const v1::Prediction& prediction, const v1::Warning& warning) {
  return std::ranges::all_of(prediction.channels(), [&](const v1::Prediction::Channel& channel) {
    return std::ranges::any_of(channel.caveats().warnings(), [&](const v1::Warning& other) {
      return other.kind() == warning.kind();
    });
  });
}

std::vector<Limit> limits_of(const v1::Prediction& prediction) {
  std::vector<Limit> grave, others;
  const auto of_channel = [&](const v1::Prediction::Channel& channel, const std::string& text) {
    return prediction.channels_size() == 1
               ? sentence(text)
               : fmt::format("{}: {}", channel.channel(), sentence(text));
  };
  for (const v1::Prediction::Channel& channel : prediction.channels()) {
    const v1::AnswerWarnings& caveats = channel.caveats();
    const v1::OutlierScore& outlier = caveats.outlier();
    if (outlier.is_outlier()) {
      grave.push_back(
          {of_channel(channel,
                      fmt::format("the photograph is an outlier, {:.1f} times as far "
                                  "from the images of its training as 99 % of such images: {}",
                                  outlier.score(), outlier.reason())),
           true});
    }
    for (const v1::Warning& warning : caveats.warnings()) {
      if (!in_all_channels(prediction, warning)) {
        others.push_back({of_channel(channel, warning.text())});
      } else if (&channel == &prediction.channels(0)) {
        others.push_back({sentence(warning.text())});
      }
    }
    if (caveats.at_bounds_size() == 0) continue;
    std::vector<std::string> ends;
    for (const int bound : caveats.at_bounds()) {
      ends.push_back(in_words(static_cast<v1::MaterialBound>(bound)));
    }
    others.push_back({of_channel(
        channel, fmt::format("{} reaches {} that the model can answer; the material may lie beyond",
                             channel.has_posterior() ? "the 90 % interval" : "the best guess",
                             fmt::join(ends, " and ")))});
  }
  if (!prediction.channels(0).caveats().has_outlier()) {
    others.push_back(
        {"The model does not know the images of its training: whether it was trained "
         "for photographs like this is not said."});
  }
  grave.insert(grave.end(), others.begin(), others.end());
  return grave;
}

}  // namespace itn
