// The fields of what a scene consists of: a light, a reflectance, a phase function.
//
// A kind of these lists its own, by the names that they have in its message, with their ranges,
//   template <typename Self, typename Fields>
//   static void fields(Self& self, Fields& to) {
//     to.number("turbidity", self.turbidity, 1, 10);
//   }
// for who reads, checks or names them:
//   number(name, value, low, high)
//   slot(name, value, low, high)     a number that images have a derivative in
//   flag(name, value)                a bool
//   angle(name, radians, low, high)  the range in degrees
//   direction(name, vector)          of any length but 0
//   position(name, vector)           in mm; or the edge of something
//   moving_direction(name, vector)   one, or a position, whose coordinates are slots: NAME.x and so
//   moving_position(name, vector)    on
//   pixels(name, map)                of a panorama
// Kinds are held in a std::variant, and have a kName, that of the field of their message.
#pragma once

#include <limits>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/vec.h"

namespace itn {

// The value. Throws Error (invalid input) with the name of the field, its value and its range,
// which holds the floats next to its ends. NaN is in no range.
double in_closed(const std::string& field, double value, double low, double high);

// Throws Error (invalid input) unless a field is in its range.
class FieldCheck {
 public:
  explicit FieldCheck(std::string of) : of_(std::move(of)) {}

  void number(const char* name, double value, double low, double high) const {
    in_closed(of_ + name, value, low, high);
  }
  void slot(const char* name, double value, double low, double high) const {
    number(name, value, low, high);
  }
  void flag(const char* /*name*/, bool /*value*/) const {}
  void angle(const char* name, double radians,
             double low = -std::numeric_limits<double>::infinity(),
             double high = std::numeric_limits<double>::infinity()) const;
  void direction(const char* name, Vec3d value) const;
  void position(const char* name, Vec3d value) const;
  void moving_direction(const char* name, Vec3d value) const { direction(name, value); }
  void moving_position(const char* name, Vec3d value) const { position(name, value); }
  // Looked at when they are compiled.
  template <typename Map>
  void pixels(const char* /*name*/, const Map& /*map*/) const {}

 private:
  const std::string of_;
};

// `of`: what the kind is of, as "surfaces[0]: ".
template <typename... Kinds>
void check_fields(const std::string& of, const std::variant<Kinds...>& kind) {
  const auto check = [&]<typename Kind>(const Kind& it) {
    const std::string name = Kind::kName;
    const FieldCheck fields(name.empty() ? of : of + name + ".");
    Kind::fields(it, fields);
  };
  std::visit(check, kind);
}

// Passes over fields, for who wants to hear of some alone and derives from it.
struct OtherFields {
  template <typename... Any>
  void number(const Any&... /*field*/) {}
  template <typename... Any>
  void flag(const Any&... /*field*/) {}
  template <typename... Any>
  void angle(const Any&... /*field*/) {}
  template <typename... Any>
  void direction(const Any&... /*field*/) {}
  template <typename... Any>
  void position(const Any&... /*field*/) {}
  template <typename... Any>
  void moving_direction(const Any&... /*field*/) {}
  template <typename... Any>
  void moving_position(const Any&... /*field*/) {}
  template <typename... Any>
  void pixels(const Any&... /*field*/) {}
};

// A slot of some kind of a list.
struct Slot {
  size_t kind = 0, number = 0;  // of the kind in the list, of the slot in the kind
  std::string name;             // as "checkerboard.even", or "reflectance" of a kind without a name
  double value = 0, low = 0, high = 0;  // by default, and its range
};

namespace fields_internal {
// The slots of a kind, by the names of its own.
struct SlotList : OtherFields {
  std::vector<Slot> slots;

  template <typename Number>
  void slot(const char* name, const Number& value, double low, double high) {
    slots.push_back(
        {.number = slots.size(), .name = name, .value = value, .low = low, .high = high});
  }
  void moving_direction(const char* name, Vec3d value) {
    for (const auto& [axis, number] :
         {std::pair{".x", value.x}, {".y", value.y}, {".z", value.z}}) {
      constexpr double kAny = std::numeric_limits<double>::infinity();
      slot((name + std::string(axis)).c_str(), number, -kAny, kAny);
    }
  }
  void moving_position(const char* name, Vec3d value) { moving_direction(name, value); }
};

template <typename Kind>
void append_slots(size_t kind, std::vector<Slot>& slots) {
  const Kind any{};
  SlotList of_kind;
  Kind::fields(any, of_kind);
  const std::string prefix = Kind::kName;
  for (Slot& slot : of_kind.slots) {
    slot.kind = kind;
    if (!prefix.empty()) slot.name = prefix + "." + slot.name;
    slots.push_back(slot);
  }
}
template <typename... Kinds>
std::vector<Slot> slots_of(const std::variant<Kinds...>* /*type*/) {
  std::vector<Slot> slots;
  size_t kind = 0;
  (append_slots<Kinds>(kind++, slots), ...);
  return slots;
}
}  // namespace fields_internal

// The slots of all kinds, in the order of the list.
template <typename Variant>
const std::vector<Slot>& slots_of() {
  static const std::vector<Slot> slots =
      fields_internal::slots_of(static_cast<const Variant*>(nullptr));
  return slots;
}

namespace fields_internal {
template <typename Use>
struct SlotUse : OtherFields {
  size_t left;  // slots before the one to use
  const Use& use;

  SlotUse(size_t number, const Use& use_of_it) : left(number), use(use_of_it) {}
  template <typename Number>
  void slot(const char* /*name*/, Number& value, double low, double high) {
    if (left-- == 0) use(value, low, high);
  }
  template <typename Vector>
  void moving_direction(const char* name, Vector& value) {
    constexpr double kAny = std::numeric_limits<double>::infinity();
    slot(name, value.x, -kAny, kAny);
    slot(name, value.y, -kAny, kAny);
    slot(name, value.z, -kAny, kAny);
  }
  template <typename Vector>
  void moving_position(const char* name, Vector& value) {
    moving_direction(name, value);
  }
};
}  // namespace fields_internal

// Calls use(number, low, high) with a slot's number, which it may set, and range. Returns false
// where `kinds`, a variant, is of another kind than the slot.
template <typename Kinds, typename Use>
bool use_slot(Kinds& kinds, const Slot& slot, const Use& use) {
  if (kinds.index() != slot.kind) return false;
  fields_internal::SlotUse<Use> fields(slot.number, use);
  std::visit([&](auto& kind) { kind.fields(kind, fields); }, kinds);
  return true;
}

// The number of slots of the kind that it is.
template <typename Variant>
size_t slot_count(const Variant& kind) {
  size_t count = 0;
  for (const Slot& slot : slots_of<Variant>()) count += slot.kind == kind.index() ? 1 : 0;
  return count;
}

}  // namespace itn
