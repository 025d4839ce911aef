#include "client/training/learning_rate.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace itn {

double learning_rate(const v1::TrainingConfig& config, uint64_t steps) {
  const double peak = config.learning_rate();
  if (config.schedule() != v1::TrainingConfig::COSINE) return peak;
  const auto step = static_cast<double>(steps);
  const auto warm_up = static_cast<double>(config.warmup_steps());
  if (step < warm_up) return peak * (step + 1) / warm_up;
  constexpr double kLast = 0.01;  // part of the peak
  const double rest = std::max(1.0, static_cast<double>(config.steps()) - warm_up - 1);
  const double progress = std::min(1.0, (step - warm_up) / rest);
  return peak * (kLast + (1 - kLast) * (1 + std::cos(std::numbers::pi * progress)) / 2);
}

}  // namespace itn
