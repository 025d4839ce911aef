// The models that a predictor answers with, by name and version, kept as their files are.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/files/file_stamp.h"
#include "common/learning/predictor.h"
#include "itn/v1/predict.pb.h"

namespace itn {

struct ModelStoreOptions {
  // Each [NAME=]MODEL, a MODEL as find_model() takes it. Without NAME it is that of a model that
  // comes with itn, or else the model's own. The version is the model's own.
  std::vector<std::string> models;
  // The folder of files NAME.itn, whose version is the model's own, and NAME/VERSION.itn. Empty:
  // none.
  std::filesystem::path folder;
};

// What requests may ask for.
struct ServedModel {
  std::string name, version;
  bool by_default = false;  // where no name is given, if it takes the photograph's channels
  std::string title;        // the first line of the file's card; empty if there is none
  std::shared_ptr<const Predictor> predictor;
};

// Whether version `a` is older than `b`: numbers in them count as numbers, so that 1.10 is newer
// than 1.9; what begins like another and goes on is newer.
bool is_older(const std::string& a, const std::string& b);

// Thread-safe.
class ModelStore {
 public:
  // Throws Error if one of `models` cannot be used (as find_model(), Predictor::load()), if two
  // have one name and version (kUsage), or if there is none at all. Files of the folder that cannot
  // be used are logged and left out.
  explicit ModelStore(const ModelStoreOptions& options);

  // The model of this version, or its newest if `version` is empty. An empty `name` is the default
  // for photographs of so many channels: the first of ModelStoreOptions::models that takes them;
  // without these the only name in the folder, or kDefaultModel or kDefaultGrayModel. Throws
  // StatusError (NOT_FOUND) that says which there are.
  std::shared_ptr<const Predictor> find(const std::string& name, const std::string& version,
                                        size_t channels) const;

  // By name, the newest of each first.
  std::vector<ServedModel> models() const;

  // Loads what has changed on disk, beside what is there, and takes its place when it has been
  // checked: its checksum, its shapes, and that it answers a plain image with numbers. What cannot
  // be used, or is gone, is logged and changes nothing; files that are gone from the folder are no
  // longer served. Who has found a model before keeps it. `again`: also what could not be used the
  // last time and has not changed since.
  void refresh(bool again = false);

 private:
  // A file, and what is served of it.
  struct Slot {
    std::filesystem::path path;          // file, or folder of a run
    std::string name;                    // empty: the model's own
    std::optional<std::string> version;  // absent: the model's own
    bool in_folder = false;              // else it was named
    FileStamp stamp;                     // when it was last tried
    bool failed = false;                 // then
    std::optional<ServedModel> served;
  };

  // What the folder has now takes the place of what it had, if it can be read; so, one by one, do
  // its subfolders.
  void look_into_folder();
  std::vector<Slot> slots_of_folder();  // throws fs::filesystem_error
  std::vector<std::filesystem::path> known_in(const std::filesystem::path& subfolder) const;
  // Warns once of what is looked at again and again and stays as it is, and again only after a
  // refresh without it.
  void warn_once(const std::string& warning);
  void load(Slot& slot) const;
  void publish();

  const std::filesystem::path folder_;
  std::mutex refreshing_;                    // guards slots_, default_names_, warned_, warnings_
  std::vector<Slot> slots_;                  // those that were named first
  std::vector<std::string> default_names_;   // the first that takes a photograph answers
  std::set<std::string> warned_, warnings_;  // in the last refresh, in this one
  mutable std::mutex mutex_;                 // guards served_
  std::vector<ServedModel> served_;
};

}  // namespace itn
