// The part of itn predict that needs a network.
#include "client/commands/command.h"
#include "client/interrupt.h"
#include "common/learning/predict_reply.h"
#include "common/learning/predictor.h"

namespace itn {

v1::PredictReply predict_here(const std::string& model, const Photograph& photograph) {
  set_torch_threads(1);
  Predictor predictor = Predictor::load(model);
  return to_reply(predictor.estimate(photograph, interruption()), predictor.name());
}

}  // namespace itn
