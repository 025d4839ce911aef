// The part of itn predict that needs a network.
#include <memory>
#include <variant>

#include "client/commands/command.h"
#include "client/interrupt.h"
#include "common/learning/predict_reply.h"
#include "common/learning/predictor.h"

namespace itn {

Predict predict_here(const std::filesystem::path& model) {
  set_torch_threads(1);
  const auto predictor = std::make_shared<Predictor>(Predictor::load(model));
  return [predictor](std::span<const FramedPhotograph> photographs) {
    const auto seen = [&](size_t i) {
      return predictor->seen(photographs[i].view(), interruption());
    };
    return to_reply(predictor->estimate_each(photographs.size(), seen, interruption()),
                    predictor->version());
  };
}

}  // namespace itn
