// The light of a room from a photograph of a ball that mirrors it.
#pragma once

#include <span>
#include <vector>

namespace itn {

// The outline of the ball in a photograph, in pixels from its left and top; a pixel's middle is at
// .5.
struct MirrorBall {
  double x = 0, y = 0, radius = 1;
};

// The ball that a mask shows, by its area; `mask`: in [0, 1], `width` pixels a row. Throws Error
// (invalid input) if it shows nothing, or what is not round: its longer side by more than 5 %.
MirrorBall ball_of_mask(std::span<const float> mask, int width);

// A camera that looks along -z, or below the horizon, with y up.
struct BallCamera {
  int width = 1, height = 1;  // of the photograph, in pixels
  double focal = 1;           // in pixels
  double degrees_down = 0;    // below the horizon
};

// A panorama in latitude-longitude format, `rows` x 2 `rows` pixels, top row first,
// whose middle lies where the camera looks, on the horizon: itn fit takes it with --panorama-turn 0
// for photographs of the same camera. The ball is small beside what lights it, so that it mirrors
// what comes from a direction to where it stands. `radiance`: the photograph, channels interleaved,
// as those of the panorama are.
//
// What is mirrored in the outermost hundredth of the radius is squeezed together there: the 16
// degrees about the direction behind the ball are filled from around them. Derivation: a ray of
// direction d that meets the ball where its normal is n goes on to w = d - 2 (d n) n, so that n is
// w - d, normalized; d, which depends on where the ball is met, is found by a few iterations.
std::vector<float> panorama_of_ball(std::span<const float> radiance, int channels,
                                    const BallCamera& camera, const MirrorBall& ball, int rows);

}  // namespace itn
