#!/usr/bin/python3
"""Renders, differentiates and predicts from Python, with nothing of itn but its .proto files.

    itn_client.py --worker HOST:PORT [--predictor HOST:PORT] [--proto DIR]

Needs protoc with its gRPC plugin, grpcio, protobuf and numpy (Debian: protobuf-compiler-grpc,
python3-grpcio, python3-protobuf, python3-numpy). Prints what it found as JSON.
"""
import argparse
import hashlib
import json
import pathlib
import subprocess
import sys
import tempfile

import grpc
import numpy as np


folder_of_modules = tempfile.TemporaryDirectory(prefix="itn-proto-")


def compile_protos(folder):
    """Turns the .proto files into Python modules."""
    target = folder_of_modules.name
    plugin = subprocess.check_output(["which", "grpc_python_plugin"], text=True).strip()
    protos = [f"itn/v1/{name}.proto" for name in ("scene", "render", "predict")]
    subprocess.check_call(
        ["protoc", f"--plugin=protoc-gen-grpc={plugin}", "-I", str(folder),
         f"--python_out={target}", f"--grpc_out={target}", *protos])
    sys.path.insert(0, target)


def cube_on_the_ground(pb):
    """A cube of 1 mm under sun and sky, its triangles sent inline."""
    corners = np.array([[x, y, z] for x in (-.5, .5) for y in (0, 1) for z in (-.5, .5)], "<f4")
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], "<u4")
    scene = pb.Scene()
    scene.object.mesh.triangles.positions = corners.tobytes()
    scene.object.mesh.triangles.indices = triangles.tobytes()
    ground = scene.surfaces.add().rectangle
    ground.half_u.x, ground.half_v.z = 20, -20
    scene.lights.add().sun_sky.sun_angular_radius_degrees = 18.75
    scene.camera.origin.y, scene.camera.origin.z = 9.28, -32.8
    scene.camera.target.y = 0.5
    scene.camera.fov_degrees = 2.5
    scene.film.width = scene.film.height = 32
    return scene.SerializeToString()


def render(worker, pb, scene, albedo, derivatives):
    """One call. The scene is named by its digest, and sent only if the worker asks for it."""
    request = pb.RenderGradRequest(
        scene_digest=hashlib.sha256(scene).digest(),
        material=pb.Material(sigma_t=30, albedo=albedo, g=0.3),
        spp=64, seed=1, derivatives=derivatives, estimates=2)
    try:
        return worker.RenderGrad(request, timeout=120)
    except grpc.RpcError as error:
        if error.code() != grpc.StatusCode.FAILED_PRECONDITION:
            raise
    request.scene = scene
    return worker.RenderGrad(request, timeout=120)


def image(reply, data):
    return np.frombuffer(data, "<f4").reshape(reply.height, reply.width)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, help="HOST:PORT of an itn-worker")
    parser.add_argument("--predictor", help="HOST:PORT of an itn-predictor")
    parser.add_argument("--proto", type=pathlib.Path, help="folder of itn/v1/*.proto",
                        default=pathlib.Path(__file__).resolve().parents[2] / "proto")
    arguments = parser.parse_args()
    compile_protos(arguments.proto)
    from itn.v1 import render_pb2, render_pb2_grpc, scene_pb2, predict_pb2, predict_pb2_grpc

    worker = render_pb2_grpc.RenderServiceStub(grpc.insecure_channel(arguments.worker))
    scene = cube_on_the_ground(scene_pb2)
    parameters = [render_pb2.SIGMA_T, render_pb2.ALBEDO, render_pb2.G]
    reply = render(worker, render_pb2, scene, 0.8, parameters)
    radiance = np.mean([image(reply, e.radiance) for e in reply.estimates], axis=0)
    mask = image(reply, reply.mask)
    on_object = mask > 0.5
    result = {"radiance": float(radiance[on_object].mean())}
    for k, parameter in enumerate(parameters):
        derivative = np.mean([image(reply, e.derivatives[k]) for e in reply.estimates], axis=0)
        name = render_pb2.Parameter.Name(parameter).lower()
        result[f"d radiance / d {name}"] = float(derivative[on_object].mean())

    # The same derivative in the albedo by finite differences, with the same random numbers.
    def radiance_at(albedo):
        r = render(worker, render_pb2, scene, albedo, [])
        return np.mean([image(r, e.radiance)[on_object].mean() for e in r.estimates])

    result["finite difference in albedo"] = float((radiance_at(0.81) - radiance_at(0.79)) / 0.02)

    if arguments.predictor:
        predictor = predict_pb2_grpc.PredictServiceStub(grpc.insecure_channel(arguments.predictor))
        answer = predictor.Predict(predict_pb2.PredictRequest(
            width=reply.width, height=reply.height, image=radiance.astype("<f4").tobytes(),
            mask=mask.astype("<f4").tobytes()), timeout=60)
        material = answer.materials[0]
        result["prediction"] = {"sigma_t": material.sigma_t, "albedo": material.albedo,
                                "g": material.g}
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
