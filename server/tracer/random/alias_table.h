// Draws one of many cells with given weights, in constant time: Walker, "An Efficient Method for
// Generating Discrete Random Variables with General Distributions", 1977, with Vose's construction.
#pragma once

#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace itn::tracer {

class AliasTable {
 public:
  struct Entry {
    float own;  // probability of keeping the cell, against `other`
    uint32_t other;
  };

  explicit AliasTable(const std::vector<double>& weights)
      : entries_(weights.size()), probabilities_(weights.size()) {
    const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
    const auto n = static_cast<double>(weights.size());
    std::vector<double> scaled(weights.size());
    std::vector<uint32_t> small, large;
    for (uint32_t i = 0; i < weights.size(); ++i) {
      probabilities_[i] = static_cast<float>(weights[i] / sum);
      scaled[i] = weights[i] / sum * n;
      (scaled[i] < 1 ? small : large).push_back(i);
    }
    while (!small.empty() && !large.empty()) {
      const uint32_t poor = small.back(), rich = large.back();
      small.pop_back();
      entries_[poor] = {static_cast<float>(scaled[poor]), rich};
      scaled[rich] -= 1 - scaled[poor];
      if (scaled[rich] < 1) {
        large.pop_back();
        small.push_back(rich);
      }
    }
    for (const auto& rest : {small, large}) {
      for (const uint32_t i : rest) entries_[i] = {1, i};
    }
  }

  const Entry* entries() const { return entries_.data(); }
  const float* probabilities() const { return probabilities_.data(); }
  size_t memory() const { return entries_.size() * (sizeof(Entry) + sizeof(float)); }

 private:
  std::vector<Entry> entries_;
  std::vector<float> probabilities_;
};

}  // namespace itn::tracer
