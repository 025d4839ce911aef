#include "tests/fuzz/message_mutation.h"

#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <limits>
#include <memory>
#include <vector>

#include "client/scene/text_proto.h"
#include "common/error.h"

// Changes bytes in place, and returns how many there are then: libFuzzer's, or run_corpus.cpp's.
extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace itn::testing {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

class Mutation {
 public:
  Mutation(const NestedMessages& nested, std::mt19937& random) : nested_(nested), random_(random) {}

  void change(Message& message) {
    const auto& type = *message.GetDescriptor();
    if (type.field_count() == 0) return;
    const FieldDescriptor& field = *type.field(static_cast<int>(below(type.field_count())));
    if (field.is_repeated()) {
      change_repeated(message, field);
    } else {
      change_single(message, field);
    }
  }

 private:
  // At random, below n > 0.
  size_t below(size_t n) { return std::uniform_int_distribution<size_t>(0, n - 1)(random_); }
  bool one_in(size_t n) { return below(n) == 0; }

  void change_single(Message& message, const FieldDescriptor& field) {
    const Reflection& r = *message.GetReflection();
    if (one_in(8)) return r.ClearField(&message, &field);
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_MESSAGE: return change(*r.MutableMessage(&message, &field));
      case FieldDescriptor::CPPTYPE_STRING:
        return r.SetString(&message, &field, text(field, r.GetString(message, &field)));
      case FieldDescriptor::CPPTYPE_DOUBLE:
        return r.SetDouble(&message, &field, number(r.GetDouble(message, &field)));
      case FieldDescriptor::CPPTYPE_FLOAT:
        return r.SetFloat(&message, &field,
                          static_cast<float>(number(double{r.GetFloat(message, &field)})));
      case FieldDescriptor::CPPTYPE_BOOL: return r.SetBool(&message, &field, one_in(2));
      case FieldDescriptor::CPPTYPE_ENUM:
        return r.SetEnumValue(&message, &field, static_cast<int>(below(16)));
      case FieldDescriptor::CPPTYPE_INT32:
        return r.SetInt32(&message, &field,
                          static_cast<int32_t>(integer(r.GetInt32(message, &field))));
      case FieldDescriptor::CPPTYPE_INT64:
        return r.SetInt64(&message, &field,
                          static_cast<int64_t>(integer(r.GetInt64(message, &field))));
      case FieldDescriptor::CPPTYPE_UINT32:
        return r.SetUInt32(&message, &field,
                           static_cast<uint32_t>(integer(r.GetUInt32(message, &field))));
      case FieldDescriptor::CPPTYPE_UINT64:
        return r.SetUInt64(&message, &field, integer(r.GetUInt64(message, &field)));
    }
  }

  // Adds an element, removes one, or moves one to another place; of messages, changes one most of
  // the time.
  void change_repeated(Message& message, const FieldDescriptor& field) {
    const Reflection& r = *message.GetReflection();
    const int size = r.FieldSize(message, &field);
    if (size == 0 || one_in(8)) return add(message, field);
    const auto any = [&] { return static_cast<int>(below(static_cast<size_t>(size))); };
    const bool is_message = field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
    if (is_message && !one_in(4)) return change(*r.MutableRepeatedMessage(&message, &field, any()));
    if (one_in(2)) return r.RemoveLast(&message, &field);
    r.SwapElements(&message, &field, any(), any());
  }

  void add(Message& message, const FieldDescriptor& field) {
    const Reflection& r = *message.GetReflection();
    switch (field.cpp_type()) {
      case FieldDescriptor::CPPTYPE_MESSAGE: {
        const int size = r.FieldSize(message, &field);
        Message& added = *r.AddMessage(&message, &field);
        if (size > 0 && one_in(2)) added.CopyFrom(r.GetRepeatedMessage(message, &field, size - 1));
        return change(added);
      }
      case FieldDescriptor::CPPTYPE_STRING: return r.AddString(&message, &field, text(field, ""));
      case FieldDescriptor::CPPTYPE_DOUBLE: return r.AddDouble(&message, &field, number(0));
      case FieldDescriptor::CPPTYPE_FLOAT:
        return r.AddFloat(&message, &field, static_cast<float>(number(0)));
      case FieldDescriptor::CPPTYPE_BOOL: return r.AddBool(&message, &field, one_in(2));
      case FieldDescriptor::CPPTYPE_ENUM:
        return r.AddEnumValue(&message, &field, static_cast<int>(below(16)));
      case FieldDescriptor::CPPTYPE_INT32:
        return r.AddInt32(&message, &field, static_cast<int32_t>(integer(0)));
      case FieldDescriptor::CPPTYPE_INT64:
        return r.AddInt64(&message, &field, static_cast<int64_t>(integer(0)));
      case FieldDescriptor::CPPTYPE_UINT32:
        return r.AddUInt32(&message, &field, static_cast<uint32_t>(integer(0)));
      case FieldDescriptor::CPPTYPE_UINT64: return r.AddUInt64(&message, &field, integer(0));
    }
  }

  double number(double old) {
    using Limits = std::numeric_limits<float>;
    static constexpr double kSome[] = {0,
                                       -0.0,
                                       1,
                                       -1,
                                       0.5,
                                       0.99,
                                       1e-6,
                                       1e6,
                                       1e9,
                                       90,
                                       180,
                                       -1e6,
                                       Limits::max(),
                                       Limits::min(),
                                       Limits::infinity(),
                                       Limits::quiet_NaN()};
    switch (below(5)) {
      case 0: return kSome[below(std::size(kSome))];
      case 1: return old * std::pow(10, std::uniform_real_distribution<double>(-3, 3)(random_));
      case 2: return std::nextafter(old, one_in(2) ? Limits::max() : Limits::lowest());
      case 3: return (one_in(8) ? -1 : 1) * std::ldexp(1, exponent());
      default: return old + std::normal_distribution<double>()(random_);
    }
  }

  // The exponent of any float, denormal ones among them.
  int exponent() { return std::uniform_int_distribution<int>(-149, 127)(random_); }

  // Bytes that may be floats: one of them, or all, by another exponent.
  std::string scaled(std::string bytes) {
    const size_t count = bytes.size() / sizeof(float);
    const size_t begin = one_in(2) ? 0 : below(count);
    const size_t end = begin == 0 ? count : begin + 1;
    const int by = exponent();
    for (size_t i = begin; i < end; ++i) {
      float value = 0;
      std::memcpy(&value, &bytes[i * sizeof value], sizeof value);
      value = std::ldexp(value, by);
      std::memcpy(&bytes[i * sizeof value], &value, sizeof value);
    }
    return bytes;
  }

  uint64_t integer(uint64_t old) {
    static constexpr uint64_t kSome[] = {
        0, 1, 2, 3, 16, 0x7f, 0xff, 0xffff, 0x7fffffff, 0x80000000, 0xffffffff, ~uint64_t{0}};
    switch (below(3)) {
      case 0: return kSome[below(std::size(kSome))];
      case 1: return old + below(5) - 2;
      default: return one_in(2) ? old * 2 : old / 2;
    }
  }

  std::string text(const FieldDescriptor& field, const std::string& old) {
    const auto found = nested_.find(field.full_name());
    if (found != nested_.end() && !one_in(8)) {
      const std::unique_ptr<Message> inside(found->second->New());
      if (inside->ParseFromString(old)) {
        change(*inside);
        return inside->SerializeAsString();
      }
    }
    if (field.type() == FieldDescriptor::TYPE_BYTES && old.size() >= sizeof(float) && one_in(2)) {
      return scaled(old);
    }
    constexpr size_t kMaxMore = 16;
    std::string bytes = old;
    bytes.resize(old.size() + kMaxMore);
    bytes.resize(
        LLVMFuzzerMutate(reinterpret_cast<uint8_t*>(bytes.data()), old.size(), bytes.size()));
    if (field.type() == FieldDescriptor::TYPE_STRING) {  // UTF-8, or it is no message any more
      std::ranges::replace_if(
          bytes, [](char c) { return c < ' ' || c > '~'; }, '?');
    }
    return bytes;
  }

  const NestedMessages& nested_;
  std::mt19937& random_;
};

}  // namespace

void mutate(Message& message, const NestedMessages& nested, std::mt19937& random) {
  const int changes = 1 << std::uniform_int_distribution<int>(0, 3)(random);
  for (int i = 0; i < changes; ++i) Mutation(nested, random).change(message);
}

size_t mutated_input(uint8_t* data, size_t size, size_t max_size, unsigned seed,
                     const Change& change) {
  std::mt19937 random(seed);
  if (random() % 2 == 0) {
    const auto changed = change(std::string(reinterpret_cast<const char*>(data), size), random);
    if (changed && changed->size() <= max_size) {
      std::ranges::copy(*changed, data);
      return changed->size();
    }
  }
  return LLVMFuzzerMutate(data, size, max_size);
}

Change change_text(const Message& prototype) {
  return
      [&prototype](const std::string& input, std::mt19937& random) -> std::optional<std::string> {
        const std::unique_ptr<Message> message(prototype.New());
        try {
          parse_text_proto(input, "input", *message);
        } catch (const Error&) {
          return std::nullopt;
        }
        mutate(*message, {}, random);
        return to_text_proto(*message);
      };
}

}  // namespace itn::testing
