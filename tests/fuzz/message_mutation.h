// Mutations that know protobuf messages: of random bytes hardly any are a message, and of changed
// ones few are still one.
#pragma once

#include <google/protobuf/message.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <random>
#include <string>

// libFuzzer calls it where a target has it.
extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed);

namespace itn::testing {

// By the full name of a field of bytes: the message that is serialized in it.
using NestedMessages = std::map<std::string, const google::protobuf::Message*>;

// Changes, adds or removes a few fields, at any depth. Values are extreme, near what was there, or
// such as are common.
void mutate(google::protobuf::Message& message, const NestedMessages& nested, std::mt19937& random);

// What LLVMFuzzerCustomMutator does: every other time changes the bytes as if there were no
// messages, otherwise by `change`, which returns nothing if these bytes hold none.
using Change = std::function<std::optional<std::string>(const std::string& input, std::mt19937&)>;
size_t mutated_input(uint8_t* data, size_t size, size_t max_size, unsigned seed,
                     const Change& change);

// A Change of inputs that are a serialized Message.
template <typename Message>
Change change_serialized(NestedMessages nested = {}) {
  return [nested](const std::string& input, std::mt19937& random) -> std::optional<std::string> {
    Message message;
    if (!message.ParseFromString(input)) return std::nullopt;
    mutate(message, nested, random);
    return message.SerializeAsString();
  };
}

// A Change of inputs that are the text format of a Message.
Change change_text(const google::protobuf::Message& prototype);

}  // namespace itn::testing
