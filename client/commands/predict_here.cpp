// The part of itn predict that needs a network.
#include "client/commands/command.h"
#include "client/interrupt.h"
#include "common/learning/predictor.h"

namespace itn {

v1::PredictReply predict_here(const std::string& model, const Photograph& photograph) {
  set_torch_threads(1);
  Predictor predictor = Predictor::load(model);
  v1::PredictReply reply;
  for (const Material& material : predictor.predict(photograph, interruption())) {
    v1::Material& proto = *reply.add_materials();
    proto.set_sigma_t(material.sigma_t);
    proto.set_albedo(material.albedo);
    proto.set_g(material.g);
  }
  reply.set_model(predictor.name());
  return reply;
}

}  // namespace itn
