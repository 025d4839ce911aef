#include "client/dataset/name_split.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "client/dataset/choices.h"
#include "client/dataset/sampler.h"
#include "common/error.h"

namespace itn {
namespace {

// Takes `count` names off the end of `order`.
std::vector<std::string> taken(std::vector<std::string>& order, size_t count) {
  std::vector<std::string> names(order.end() - static_cast<std::ptrdiff_t>(count), order.end());
  order.resize(order.size() - count);
  return names;
}

size_t share_of(double fraction, size_t count) {
  if (fraction == 0) return 0;
  return std::max<size_t>(1,
                          static_cast<size_t>(std::lround(fraction * static_cast<double>(count))));
}

// Takes that part of `total` off the end of `order`, but leaves so many for others.
std::vector<std::string> share_taken(std::vector<std::string>& order, double fraction, size_t total,
                                     size_t others) {
  const size_t free = order.size() > others ? order.size() - others : 0;
  return taken(order, std::min(share_of(fraction, total), free));
}

// Takes those names out of `names`.
std::vector<std::string> take_named(const google::protobuf::RepeatedPtrField<std::string>& wanted,
                                    std::vector<std::string>& names, const char* purpose) {
  for (const std::string& name : wanted) {
    require(std::ranges::count(names, name) == 1,
            fmt::format("there is no shape \"{}\" to {} with; {}", name, purpose,
                        names.empty() ? "none is left"
                                      : fmt::format("there are {}", fmt::join(names, ", "))));
    std::erase(names, name);
  }
  return {wanted.begin(), wanted.end()};
}

// The names of a manifest's entries in a split, in the order of their names.
template <typename Entries>
std::vector<std::string> names_in(const Entries& entries, v1::Split split) {
  std::vector<std::string> names;
  for (const auto& entry : entries) {
    if (entry.split() == split) names.push_back(entry.name());
  }
  std::ranges::sort(names);
  return names;
}

template <typename Entries>
NameSplit split_in(const Entries& entries) {
  return {.train = names_in(entries, v1::SPLIT_TRAIN),
          .validation = names_in(entries, v1::SPLIT_VALIDATION),
          .test = names_in(entries, v1::SPLIT_TEST)};
}

NameSplit sorted(NameSplit split) {
  for (std::vector<std::string>* part : {&split.train, &split.validation, &split.test}) {
    std::ranges::sort(*part);
  }
  return split;
}

}  // namespace

const std::vector<std::string>& NameSplit::names(v1::Split split) const {
  return split == v1::SPLIT_TEST ? test : split == v1::SPLIT_VALIDATION ? validation : train;
}

const std::vector<std::string>& NameSplit::names_or_training(v1::Split split) const {
  return names(split).empty() ? train : names(split);
}

v1::Split NameSplit::split_of(const std::string& name) const {
  if (std::ranges::binary_search(test, name)) return v1::SPLIT_TEST;
  return std::ranges::binary_search(validation, name) ? v1::SPLIT_VALIDATION : v1::SPLIT_TRAIN;
}

NameSplit split_shapes(const v1::DatasetConfig& config, std::span<const Shape> shapes) {
  std::set<std::string> unique;
  for (const Shape& shape : shapes) {
    require(unique.insert(shape.name).second,
            fmt::format("two shapes are called \"{}\"; rename one of them", shape.name));
  }
  const size_t total = unique.size();
  const size_t splits =
      1 + (config.test_fraction() > 0 ? 1 : 0) + (config.validation_fraction() > 0 ? 1 : 0);
  require(total >= splits,
          fmt::format("there are {} shapes; training{}{} need one each at least, as they share "
                      "none{}",
                      total, config.validation_fraction() > 0 ? ", validation" : "",
                      config.test_fraction() > 0 ? " and test" : "",
                      total == 2 ? "; with --validation-fraction 0 two are enough" : ""));
  std::vector<std::string> names(unique.begin(), unique.end());
  NameSplit split;
  split.test = take_named(config.test_shapes(), names, "test");
  split.validation = take_named(config.validation_shapes(), names, "validate");
  // The rest in a random order, of which those take what have none yet, and leave one.
  std::vector<std::string> rest;
  for (const uint32_t i : permutation(static_cast<uint32_t>(names.size()),
                                      derive_seed(config.seed(), {kSplitChoice}))) {
    rest.push_back(names[i]);
  }
  const auto fill = [&](std::vector<std::string>& part, double fraction, size_t others) {
    if (part.empty()) part = share_taken(rest, fraction, total, others);
  };
  fill(split.test, config.test_fraction(),
       1 + (config.validation_fraction() > 0 && split.validation.empty() ? 1 : 0));
  fill(split.validation, config.validation_fraction(), 1);
  require(!rest.empty(), "no shape is left to train with");
  require(config.validation_fraction() == 0 || !split.validation.empty(),
          "no shape is left for validation; with --validation-fraction 0 there is none");
  split.train = std::move(rest);
  return sorted(std::move(split));
}

NameSplit split_panoramas(const v1::DatasetConfig& config, std::span<const Panorama> panoramas) {
  const auto total = static_cast<uint32_t>(panoramas.size());
  std::vector<std::string> rest;
  std::set<std::string> unique;
  for (const uint32_t i : permutation(total, derive_seed(config.seed(), {kPanoramaSplit}))) {
    rest.push_back(panoramas[i].name);
    require(unique.insert(rest.back()).second,
            fmt::format("two panoramas are called \"{}\"; rename one of them", rest.back()));
  }
  NameSplit split;
  // The training has one at least; then the test, then the validation.
  split.test = share_taken(rest, config.test_fraction(), total,
                           1 + (config.validation_fraction() > 0 && total > 2 ? 1 : 0));
  split.validation = share_taken(rest, config.validation_fraction(), total, 1);
  split.train = std::move(rest);
  return sorted(std::move(split));
}

NameSplit split_shapes(const v1::Dataset& manifest) {
  return split_in(manifest.shapes());
}

NameSplit split_panoramas(const v1::Dataset& manifest) {
  return split_in(manifest.panoramas());
}

}  // namespace itn
