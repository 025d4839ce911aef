// Keeps a ModelStore as its files are.
#pragma once

#include <chrono>
#include <memory>
#include <thread>

#include "server/predict/model_store.h"

namespace itn {

// Refreshes the store on SIGHUP, which it catches from its construction on, and every `interval`
// (0: never); on SIGHUP also tries again what could not be used. One at a time.
class ModelWatcher {
 public:
  ModelWatcher(std::shared_ptr<ModelStore> models, std::chrono::duration<double> interval);
  ~ModelWatcher();
  ModelWatcher(const ModelWatcher&) = delete;
  ModelWatcher& operator=(const ModelWatcher&) = delete;

 private:
  std::jthread thread_;
};

}  // namespace itn
