#!/usr/bin/python3
"""How fast a running worker or predictor answers, at one load after the other.

    load.py HOST:PORT [--predict] [--concurrency 1,4,16 | --rate 10,20] [--seconds 10] [--size 64] [--spp 16]

--concurrency: callers, who call again when they are answered. --rate: calls a second, evenly spaced,
whatever becomes of them; a latency counts from when the call was due, so that what a slow server holds
up is counted. Prints, for each load, answers a second, the latencies [ms] that 50, 90 and 99 % of the
answers did not exceed, and how many calls failed, by status. Python makes a few thousand calls a second.
"""
import argparse
import asyncio
import collections
import pathlib
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "client/examples"))
import grpc
import itn_client
import numpy as np


def numbers(text):
    return [float(number) for number in text.split(",")]


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("address", metavar="HOST:PORT")
    parser.add_argument("--predict", action="store_true", help="ask a predictor about a disc")
    load = parser.add_mutually_exclusive_group()
    load.add_argument("--concurrency", type=numbers, default=[1, 4, 16], metavar="N,...")
    load.add_argument("--rate", type=numbers, metavar="N,...", help="in calls a second")
    parser.add_argument("--seconds", type=float, default=10, help="of each load")
    parser.add_argument("--size", type=int, default=64, help="of the image, in pixels")
    parser.add_argument("--spp", type=int, default=16)
    return parser.parse_args()


def call_of(channel, arguments):
    """A function that makes one call."""
    from itn.v1 import predict_pb2, predict_pb2_grpc, render_pb2, render_pb2_grpc, scene_pb2
    if arguments.predict:
        y, x = np.indices((arguments.size, arguments.size)) / arguments.size - 0.5
        mask = (x**2 + y**2 < 0.1).astype("<f4")
        request = predict_pb2.PredictRequest(width=arguments.size, height=arguments.size,
                                             image=(mask * (1 - y)).astype("<f4").tobytes(),
                                             mask=mask.tobytes())
        method = predict_pb2_grpc.PredictServiceStub(channel).Predict
    else:
        scene = scene_pb2.Scene.FromString(itn_client.cube_on_the_ground(scene_pb2))
        scene.film.width = scene.film.height = arguments.size
        request = render_pb2.RenderGradRequest(
            scene=scene.SerializeToString(), spp=arguments.spp,
            material=render_pb2.Material(sigma_t=100, albedo=0.8, g=0.2))
        method = render_pb2_grpc.RenderServiceStub(channel).RenderGrad
    return lambda: method(request, timeout=60)


async def measure(call, seconds, callers=None, rate=None):
    """Latencies of answers [s], counts of what failed, and how long it took until the last ended [s]."""
    latencies, failed = [], collections.Counter()
    begin = time.perf_counter()

    async def once(due):
        try:
            await call()
            latencies.append(time.perf_counter() - due)
        except grpc.RpcError as error:
            failed[error.code().name] += 1

    async def again():
        while time.perf_counter() < begin + seconds:
            await once(time.perf_counter())

    if callers:
        await asyncio.gather(*(again() for _ in range(int(callers))))
    else:
        calls = []
        for k in range(int(rate * seconds)):
            await asyncio.sleep(max(0.0, begin + k / rate - time.perf_counter()))
            calls.append(asyncio.ensure_future(once(begin + k / rate)))
        await asyncio.gather(*calls)
    return latencies, failed, time.perf_counter() - begin


async def main(arguments):
    async with grpc.aio.insecure_channel(arguments.address) as channel:
        call = call_of(channel, arguments)
        await call()  # the scene is compiled, the network warm
        print("load           answers/s      p50      p90      p99  failed")
        for load in arguments.rate or arguments.concurrency:
            how = {"rate": load} if arguments.rate else {"callers": load}
            latencies, failed, took = await measure(call, arguments.seconds, **how)
            p = 1e3 * np.percentile(latencies or [np.nan], [50, 90, 99])
            print(f"{next(iter(how))} {load:<7g} {len(latencies) / took:9.1f}"
                  f" {p[0]:8.2f} {p[1]:8.2f} {p[2]:8.2f}  {dict(failed) or 0}")


if __name__ == "__main__":
    arguments = parse_arguments()
    with tempfile.TemporaryDirectory(prefix="itn-proto-") as folder:
        itn_client.compile_protos(itn_client.PROTO, folder)
        asyncio.run(main(arguments))
