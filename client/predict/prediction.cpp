#include "client/predict/prediction.h"

#include <fmt/format.h>

#include "common/error.h"
#include "common/scene/material_proto.h"

namespace itn {

v1::Prediction prediction_of(const std::string& name, const v1::PredictReply& reply,
                             const PredictInput& photograph) {
  if (reply.materials_size() != static_cast<int>(photograph.channels.size())) {
    throw Error(ErrorKind::kInternal,
                fmt::format("the predictor answered {} materials for {} channels",
                            reply.materials_size(), photograph.channels.size()));
  }
  v1::Prediction prediction;
  prediction.set_image(name);
  prediction.set_model(reply.model());
  *prediction.mutable_model_version() = reply.model_version();
  if (photograph.capture.has_object_size()) {
    prediction.set_object_size(photograph.capture.object_size());
  }
  for (int i = 0; i < reply.materials_size(); ++i) {
    const Material material = from_proto(reply.materials(i));
    v1::Prediction::Channel& channel = *prediction.add_channels();
    channel.set_channel(photograph.channels[static_cast<size_t>(i)]);
    channel.set_sigma_t(material.sigma_t);
    channel.set_albedo(material.albedo);
    channel.set_g(material.g);
    channel.set_sigma_a(material.sigma_a());
    channel.set_sigma_s(material.sigma_s());
    if (reply.posteriors_size() == reply.materials_size()) {
      const v1::MaterialPosterior& posterior = reply.posteriors(i);
      channel.set_sigma_a(posterior.sigma_a().mean());
      channel.set_sigma_s(posterior.sigma_s().mean());
      *channel.mutable_posterior() = posterior;
    }
    if (reply.caveats_size() == reply.materials_size()) {
      *channel.mutable_caveats() = reply.caveats(i);
    }
  }
  return prediction;
}

std::vector<Material> materials_of_1_mm(const v1::Prediction& prediction) {
  const double size = prediction.has_object_size() ? prediction.object_size() : 1;
  std::vector<Material> materials;
  for (const v1::Prediction::Channel& channel : prediction.channels()) {
    materials.push_back({channel.sigma_t() * size, channel.albedo(), channel.g()});
  }
  return materials;
}

v1::Prediction failure_of(const std::string& name, const std::string& what) {
  v1::Prediction prediction;
  prediction.set_image(name);
  prediction.set_error(what);
  return prediction;
}

}  // namespace itn
