// Columns of what paths take along, a number for each slot, and what they hold when a path begins.
#pragma once

#include <cstdint>
#include <tuple>
#include <vector>

#include "server/tracer/simd/columns.h"

namespace itn::tracer {

template <typename T, int kStart = 0>
struct StateColumn : Column<T> {
  static constexpr T kAtStart = kStart;
};
template <int kStart = 0>
using FloatState = StateColumn<float, kStart>;
template <int kStart = 0>
using UintState = StateColumn<uint32_t, kStart>;
// Columns, as many as a request needs.
template <int kStart = 0>
struct alignas(64) FloatStates : std::vector<FloatState<kStart>> {};
struct alignas(64) UintStates : std::vector<UintState<>> {};

// Calls visit(column) for every column of a list.
template <typename List, typename Visit>
void for_each_column(const List& list, const Visit& visit) {
  const auto visit_all = [&]<typename Entry>(Entry& entry) {
    if constexpr (requires { Entry::kAtStart; }) {
      visit(entry);
    } else {
      for (auto& column : entry) visit(column);
    }
  };
  std::apply([&](auto&... entries) { (visit_all(entries), ...); }, list);
}

template <typename List>
void begin_columns(const List& list, size_t slot) {
  for_each_column(list, [&](auto& column) { column[slot] = column.kAtStart; });
}
template <typename List>
void move_columns(const List& list, size_t from, size_t to) {
  for_each_column(list, [&](auto& column) { column[to] = column[from]; });
}

}  // namespace itn::tracer
