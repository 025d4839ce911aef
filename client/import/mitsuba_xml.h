// Scene files of Mitsuba 0.6 and 3, as a tree: what is meant by them is import_mitsuba.cpp's.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace itn {

// A number, a word, a colour, a vector: its attributes as they are written.
struct MitsubaProperty {
  std::string tag;
  std::map<std::string, std::string> attributes;
  mutable bool used = false;  // whoever reads it says so: what nobody read was not carried over
};

struct MitsubaPlugin;

// A plugin as a part of another one, or of several: by a reference it may come before it is
// defined.
struct MitsubaChild {
  std::string name;  // that its parent calls it, or empty
  std::shared_ptr<const MitsubaPlugin> plugin;
};

struct MitsubaPlugin {
  std::string tag, type, id;
  std::string place;  // for messages, printable: `scene.xml:12: <shape type="obj">`
  // By names as Mitsuba 3 spells them: "to_world" for "toWorld".
  std::map<std::string, MitsubaProperty> properties;
  std::map<std::string, Eigen::Affine3d> transforms;
  mutable std::set<std::string> used_transforms;
  std::vector<MitsubaChild> children;
  mutable bool used = false;

  // Each marks what it reads as used. Throws Error (invalid input) if it is not what is asked for.
  bool has(const std::string& property) const { return properties.contains(property); }
  double number(const std::string& property, double otherwise) const;
  std::string text(const std::string& property, const std::string& otherwise) const;
  // The value of a boolean: true or false, in any case.
  bool flag(const std::string& property, bool otherwise) const;
  // Linear R, G, B.
  std::array<double, 3> colour(const std::string& property, double otherwise) const;
  // Whether colour() computes it from values at wavelengths.
  bool has_spectrum(const std::string& property) const;
  Eigen::Vector3d vector(const std::string& property, const Eigen::Vector3d& otherwise) const;
  Eigen::Affine3d transform(const std::string& name) const;
  // The first child of that tag (and name, unless that is empty), or null.
  const MitsubaPlugin* child(const std::string& child_tag,
                             const std::string& child_name = "") const;
};

struct MitsubaFile {
  std::shared_ptr<const MitsubaPlugin> scene;
  bool is_3 = true;  // 0.x else: another up axis of skies
  bool has_version = true;
};

// With its defaults, for which `definitions` (by name) are taken instead, and its includes. Throws
// Error: kIo; kInvalidInput with file and line. What a few bytes may claim is bounded: files and
// tags in one another, their number, and how long texts become by their defaults.
MitsubaFile read_mitsuba(const std::filesystem::path& path,
                         const std::map<std::string, std::string>& definitions = {});

}  // namespace itn
