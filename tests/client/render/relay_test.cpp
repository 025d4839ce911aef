#include "client/render/relay.h"

#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/util/delimited_message_util.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdint>
#include <exception>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/render/local_renderer.h"
#include "client/render/relay_renderer.h"
#include "common/error.h"
#include "itn/v1/relay.pb.h"
#include "tests/support/expect_error.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using testing::deterministic_bytes;

RenderJob job_of_scene(uint64_t seed, const v1::Scene& scene = testing::cube_scene()) {
  RenderJob job;
  job.scene = serialize(scene);
  job.request = testing::small_request(8);
  job.request.set_seed(seed);
  return job;
}

std::array<int, 2> connected_sockets() {
  std::array<int, 2> sockets{};
  EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets.data()), 0);
  return sockets;
}

// The program's end, in a thread.
class Relay {
 public:
  Relay(JobRenderer& renderer, int socket)
      : socket_(socket), thread_([this, &renderer] {
          try {
            relay_renders(renderer, "1", socket_, socket_);
          } catch (const std::exception& error) {
            error_ = error.what();
          }
          ::shutdown(socket_, SHUT_RDWR);
        }) {}
  ~Relay() {
    if (thread_.joinable()) thread_.join();
    ::close(socket_);
  }

  // What it threw, when its input has ended.
  std::string error() {
    thread_.join();
    return error_;
  }

 private:
  const int socket_;
  std::string error_;
  std::thread thread_;
};

class RelayTest : public ::testing::Test {
 protected:
  // As in the program: a reader that has gone is no signal.
  RelayTest() { std::signal(SIGPIPE, SIG_IGN); }

  SceneCache cache_{size_t{64} << 20};
  LocalRenderer local_{cache_, 2};
  std::array<int, 2> sockets_ = connected_sockets();
};

TEST_F(RelayTest, AnswersTheSameWhateverSceneWasBefore) {
  Relay relay(local_, sockets_[1]);
  RelayRenderer renderer(sockets_[0], "1");
  EXPECT_EQ(renderer.parallelism(), 1);
  std::vector<RenderJob> jobs;
  for (const uint32_t width : {16, 16, 12, 16, 12, 12}) {
    jobs.push_back(job_of_scene(jobs.size(), testing::cube_scene(width, 16)));
  }
  std::vector<std::future<v1::RenderGradReply>> pending;
  for (const RenderJob& job : jobs) pending.push_back(renderer.submit(job));
  for (size_t i = 0; i < jobs.size(); ++i) {
    EXPECT_EQ(deterministic_bytes(pending[i].get()),
              deterministic_bytes(local_.submit(jobs[i]).get()));
  }
  EXPECT_EQ(renderer.parallelism(), local_.parallelism());
}

TEST_F(RelayTest, PassesOnWhatIsWrong) {
  Relay relay(local_, sockets_[1]);
  RelayRenderer renderer(sockets_[0], "1");
  RenderJob wrong = job_of_scene(1);
  wrong.request.mutable_material()->set_albedo(2);
  std::future<v1::RenderGradReply> failing = renderer.submit(wrong);
  std::future<v1::RenderGradReply> right = renderer.submit(job_of_scene(2));
  testing::expect_error(ErrorKind::kInvalidInput, {"albedo"}, [&] { failing.get(); });
  EXPECT_EQ(right.get().width(), 16U);
}

TEST_F(RelayTest, RefusesAnotherVersion) {
  Relay relay(local_, sockets_[1]);
  RelayRenderer renderer(sockets_[0], "2");
  testing::expect_error(ErrorKind::kInternal, {"version 1, not 2"},
                        [&] { renderer.submit(job_of_scene(1)).get(); });
}

TEST_F(RelayTest, SaysThatTheProgramHasEnded) {
  RelayRenderer renderer(sockets_[0], "1");
  std::future<v1::RenderGradReply> under_way = renderer.submit(job_of_scene(1));
  ::shutdown(sockets_[1], SHUT_RDWR);
  testing::expect_error(ErrorKind::kUnavailable, {"ended"}, [&] { under_way.get(); });
  testing::expect_error(ErrorKind::kUnavailable, {"ended"},
                        [&] { renderer.submit(job_of_scene(2)).get(); });
  ::close(sockets_[1]);
}

TEST_F(RelayTest, EndsWithItsInputThoughARenderIsUnderWay) {
  Relay relay(local_, sockets_[1]);
  {
    RelayRenderer renderer(sockets_[0], "1");
    RenderJob endless = job_of_scene(1);
    endless.request.set_spp(1 << 20);
    endless.request.mutable_material()->set_albedo(1);
    renderer.submit(endless);
  }
  EXPECT_EQ(relay.error(), "");
}

TEST_F(RelayTest, IsAskedBeforeItReads) {
  std::optional<Relay> relay;  // ends after its renderer
  RelayRenderer renderer(sockets_[0], "1");
  v1::Scene large = testing::cube_scene();
  large.mutable_object()->mutable_mesh()->mutable_triangles()->mutable_positions()->resize(1 << 24);
  std::future<v1::RenderGradReply> later = renderer.submit(job_of_scene(1, large));
  std::future<v1::RenderGradReply> last = renderer.submit(job_of_scene(2));
  EXPECT_EQ(renderer.parallelism(), 1);
  relay.emplace(local_, sockets_[1]);
  EXPECT_EQ(last.get().width(), 16U);
}

TEST_F(RelayTest, EndsWhenNobodyReads) {
  std::array<int, 2> in{}, out{};
  ASSERT_EQ(::pipe(in.data()) + ::pipe(out.data()), 0);
  ::close(out[0]);
  relay_renders(local_, "1", in[0], out[1]);
  for (const int one : {in[0], in[1], out[1], sockets_[0], sockets_[1]}) ::close(one);
}

// Sends a request with its scene, and no more.
void send_last(int socket, const RenderJob& job) {
  v1::RenderGradRequest request = job.request;
  request.set_scene(job.scene->bytes);
  request.set_scene_digest(job.scene->digest);
  ASSERT_TRUE(google::protobuf::util::SerializeDelimitedToFileDescriptor(request, socket));
  ::shutdown(socket, SHUT_WR);
}

TEST_F(RelayTest, AnswersWhatItReadBeforeTheEnd) {
  Relay relay(local_, sockets_[1]);
  send_last(sockets_[0], job_of_scene(1));
  google::protobuf::io::FileInputStream replies(sockets_[0]);
  v1::RelayReply reply;
  ASSERT_TRUE(google::protobuf::util::ParseDelimitedFromZeroCopyStream(&reply, &replies, nullptr));
  EXPECT_EQ(reply.render().width(), 16U);
  EXPECT_EQ(relay.error(), "");
  ::close(sockets_[0]);
}

TEST_F(RelayTest, SaysThatItCannotWrite) {
  std::array<int, 2> pipe{};
  ASSERT_EQ(::pipe(pipe.data()), 0);
  send_last(sockets_[0], job_of_scene(1));
  testing::expect_error(ErrorKind::kIo, {"cannot write an answer"},
                        [&] { relay_renders(local_, "1", sockets_[1], pipe[0]); });
  for (const int one : {pipe[0], pipe[1], sockets_[0], sockets_[1]}) ::close(one);
}

TEST_F(RelayTest, RefusesOtherInput) {
  for (const std::string& text : {std::string("render!\n"), std::string(10, '\xff') + '\1'}) {
    const std::array<int, 2> sockets = connected_sockets();
    Relay relay(local_, sockets[1]);
    ASSERT_EQ(::write(sockets[0], text.data(), text.size()), static_cast<ssize_t>(text.size()));
    ::shutdown(sockets[0], SHUT_WR);
    EXPECT_EQ(relay.error(), "what is read is no RenderGradRequest, or was cut short");
    ::close(sockets[0]);
  }
}

TEST_F(RelayTest, WantsASceneOfTheFirstRequest) {
  RenderJob job = job_of_scene(1);
  auto empty = std::make_shared<SerializedScene>(*job.scene);
  empty->bytes.clear();
  job.scene = empty;
  Relay relay(local_, sockets_[1]);
  RelayRenderer renderer(sockets_[0], "1");
  testing::expect_error(ErrorKind::kInvalidInput, {"scene: it is missing"},
                        [&] { renderer.submit(job).get(); });
}

}  // namespace
}  // namespace itn
