#!/usr/bin/python3
"""Renders, differentiates and predicts from Python, with nothing of itn but its .proto files.

    itn_client.py [--worker HOST:PORT] [--predictor HOST:PORT] [--proto DIR]
                  [--tls-ca FILE [--tls-cert FILE --tls-key FILE] [--tls-server-name NAME]
                   [--token-file FILE]]

Needs protoc with its gRPC plugin, grpcio, protobuf and numpy (Debian: protobuf-compiler-grpc,
python3-grpcio, python3-protobuf, python3-numpy). Prints what it found as JSON: means over the
object with their standard errors, and whether each derivative agrees with its finite difference.

What fails is said in one line; exit codes are those of the command line (docs/errors.md), and 1 if
a derivative does not agree.
"""
import argparse
import hashlib
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

ESTIMATES = 8  # independent, so that their spread tells the error of their mean
PARAMETERS = ["sigma_t", "albedo", "g", "surface[0].reflectance"]
PROTO = pathlib.Path(__file__).resolve().parents[2] / "proto"


class Failure(Exception):
    """What a user can act on, and the exit code that says of which kind it is."""

    def __init__(self, code, message):
        super().__init__(message)
        self.code = code


try:
    import grpc
    import numpy as np
except ImportError as error:
    print(f"itn_client.py: {error}; Debian has python3-grpcio and python3-numpy", file=sys.stderr)
    sys.exit(4)

# As common/rpc/status.cpp has them, for the statuses that a server answers.
EXIT_CODES = {grpc.StatusCode.INVALID_ARGUMENT: 3, grpc.StatusCode.UNAVAILABLE: 5,
              grpc.StatusCode.UNAUTHENTICATED: 5, grpc.StatusCode.UNIMPLEMENTED: 5, grpc.StatusCode.DEADLINE_EXCEEDED: 5,
              grpc.StatusCode.RESOURCE_EXHAUSTED: 7, grpc.StatusCode.CANCELLED: 130}


def compile_protos(folder, target):
    """Turns the .proto files into Python modules, in the folder `target`."""
    plugin = shutil.which("grpc_python_plugin")
    if not plugin or not shutil.which("protoc"):
        raise Failure(4, "there is no protoc with grpc_python_plugin; Debian has them in "
                         "protobuf-compiler and protobuf-compiler-grpc")
    protos = [f"itn/v1/{name}.proto" for name in ("scene", "render", "predict")]
    if not (folder / protos[0]).is_file():
        raise Failure(4, f"--proto {folder}: there is no {protos[0]} in it")
    done = subprocess.run(
        ["protoc", f"--plugin=protoc-gen-grpc={plugin}", "-I", str(folder),
         f"--python_out={target}", f"--grpc_out={target}", *protos],
        capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise Failure(4, f"protoc cannot read {folder}: {done.stderr.strip()}")
    sys.path.insert(0, target)


def cube_on_the_ground(pb, reflectance=0.5):
    """A cube of 1 mm under sun and sky, its triangles sent inline."""
    corners = np.array([[x, y, z] for x in (-.5, .5) for y in (0, 1) for z in (-.5, .5)], "<f4")
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], "<u4")
    scene = pb.Scene()
    scene.object.mesh.triangles.positions = corners.tobytes()
    scene.object.mesh.triangles.indices = triangles.tobytes()
    ground = scene.surfaces.add()
    ground.rectangle.half_u.x, ground.rectangle.half_v.z = 20, -20
    ground.reflectance = reflectance
    scene.lights.add().sun_sky.sun_angular_radius_degrees = 18.75
    scene.camera.origin.y, scene.camera.origin.z = 9.28, -32.8
    scene.camera.target.y = 0.5
    scene.camera.fov_degrees = 2.5
    scene.film.width = scene.film.height = 32
    return scene.SerializeToString()


def render(worker, pb, scene, albedo, parameters=(), weights=None):
    """One call. The scene is named by its digest, and sent only if the worker asks for it.

    With weights, an image of them: instead of derivative images, the gradient of the sum over the pixels
    of weight times radiance.
    """
    request = pb.RenderGradRequest(
        scene_digest=hashlib.sha256(scene).digest(),
        material=pb.Material(sigma_t=30, albedo=albedo, g=0.3), spp=64 * ESTIMATES, seed=1,
        parameters=parameters, estimates=ESTIMATES)
    if weights is not None:
        request.gradient.weight = weights.astype("<f4").tobytes()
    try:
        return worker.RenderGrad(request, timeout=120)
    except grpc.RpcError as error:
        if error.code() != grpc.StatusCode.FAILED_PRECONDITION:
            raise
    request.scene = scene
    return worker.RenderGrad(request, timeout=120)


def image(reply, data):
    return np.frombuffer(data, "<f4").reshape(reply.height, reply.width)


def mean_and_error(estimates):
    """Of independent estimates: their mean and its standard error."""
    return {"mean": float(np.mean(estimates)),
            "standard error": float(np.std(estimates, ddof=1) / np.sqrt(len(estimates)))}


def compared(derivatives, differences):
    """A derivative beside its finite difference; they share their noise, estimate by estimate."""
    gap = mean_and_error(derivatives - differences)
    # Eight estimates exceed five standard errors once in 600 times; the finite difference may be
    # half a percent off by itself.
    most = 5 * gap["standard error"] + 0.005 * abs(float(np.mean(differences)))
    return {"derivative": mean_and_error(derivatives),
            "finite difference": mean_and_error(differences),
            "agrees": bool(abs(gap["mean"]) <= most)}


def render_and_compare(worker, render_pb2, scene_pb2):
    """What is printed of the renders, and the image and mask of the first."""
    scene = cube_on_the_ground(scene_pb2)
    reply = render(worker, render_pb2, scene, 0.8, PARAMETERS)
    mask = image(reply, reply.mask)
    on_object = mask > 0.5

    def of_estimates(answer, plane):
        return np.array([image(answer, plane(e))[on_object].mean() for e in answer.estimates])

    def radiance_of(answer):
        return of_estimates(answer, lambda e: e.radiance)

    derivatives = {name: of_estimates(reply, lambda e, k=k: e.derivatives[k])
                   for k, name in enumerate(PARAMETERS)}
    # Finite differences, with the same random numbers.
    differences = {
        "albedo": (radiance_of(render(worker, render_pb2, scene, 0.81)) -
                   radiance_of(render(worker, render_pb2, scene, 0.79))) / 0.02,
        "surface[0].reflectance": (
            radiance_of(render(worker, render_pb2, cube_on_the_ground(scene_pb2, 0.55), 0.8)) -
            radiance_of(render(worker, render_pb2, cube_on_the_ground(scene_pb2, 0.45), 0.8))) / 0.1}
    result = {"radiance": mean_and_error(radiance_of(reply))}
    for name, values in derivatives.items():
        result[f"d radiance / d {name}"] = (
            compared(values, differences[name]) if name in differences
            else {"derivative": mean_and_error(values)})
    # The same without images: the mean over the object is a weighted sum of the pixels.
    gradient = render(worker, render_pb2, scene, 0.8, PARAMETERS, on_object / on_object.sum())
    numbers = np.array([e.gradient for e in gradient.estimates])
    images = np.array([derivatives[name] for name in PARAMETERS]).T
    result["gradient is that of the images"] = {
        "agrees": bool(np.allclose(numbers, images, rtol=1e-3, atol=1e-5))}
    return result, np.mean([image(reply, e.radiance) for e in reply.estimates], axis=0), mask


def calling(what, address, call):
    """What `call` returns; a Failure that names the server where it does not answer as it should."""
    try:
        return call()
    except grpc.RpcError as error:
        if error.code() == grpc.StatusCode.UNIMPLEMENTED:
            raise Failure(5, f"{address} is not a {what}; itn-{what} is one") from error
        raise Failure(EXIT_CODES.get(error.code(), 1),
                      f"{what} {address}: {error.details()}") from error


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", metavar="HOST:PORT", default="127.0.0.1:50051",
                        help="an itn-worker (default: %(default)s, where it listens by itself)")
    parser.add_argument("--predictor", metavar="HOST:PORT",
                        help="an itn-predictor, to predict from the image (default: none)")
    parser.add_argument("--tls-ca", metavar="FILE", type=pathlib.Path,
                        help="certificate of the authority of the servers' certificates: "
                             "connections are by TLS")
    parser.add_argument("--tls-cert", metavar="FILE", type=pathlib.Path,
                        help="certificate to show to servers that ask for one")
    parser.add_argument("--tls-key", metavar="FILE", type=pathlib.Path, help="its private key")
    parser.add_argument("--tls-server-name", metavar="NAME",
                        help="what the servers' certificates call them, if not as their addresses")
    parser.add_argument("--token-file", metavar="FILE", type=pathlib.Path,
                        help="secret that the servers want of calls")
    parser.add_argument("--proto", metavar="DIR", type=pathlib.Path,
                        help="folder of itn/v1/*.proto (default: that of this repository)",
                        default=PROTO)
    arguments = parser.parse_args()
    if not arguments.tls_ca and (arguments.tls_cert or arguments.tls_server_name or
                                 arguments.token_file):
        parser.error("--tls-cert, --tls-server-name and --token-file need --tls-ca")
    if bool(arguments.tls_cert) != bool(arguments.tls_key):
        parser.error("--tls-cert and --tls-key belong together")
    return arguments


def content(path):
    try:
        return path.read_bytes() if path else None
    except OSError as error:
        raise Failure(4, f"cannot read {path}: {error.strerror}") from error


def connect_to(address, arguments):
    """A channel: by TLS, with a certificate and a token of ours, as far as they are given."""
    if not arguments.tls_ca:
        return grpc.insecure_channel(address)
    credentials = grpc.ssl_channel_credentials(
        content(arguments.tls_ca), content(arguments.tls_key), content(arguments.tls_cert))
    if arguments.token_file:
        token = content(arguments.token_file).split()[0].decode("ascii")
        credentials = grpc.composite_channel_credentials(
            credentials, grpc.access_token_call_credentials(token))
    name = arguments.tls_server_name
    options = [("grpc.ssl_target_name_override", name)] if name else []
    return grpc.secure_channel(address, credentials, options)


def run(arguments, folder_of_modules):
    compile_protos(arguments.proto, folder_of_modules)
    from itn.v1 import render_pb2, render_pb2_grpc, scene_pb2, predict_pb2, predict_pb2_grpc

    worker = render_pb2_grpc.RenderServiceStub(connect_to(arguments.worker, arguments))
    result, radiance, mask = calling(
        "worker", arguments.worker, lambda: render_and_compare(worker, render_pb2, scene_pb2))
    if arguments.predictor:
        predictor = predict_pb2_grpc.PredictServiceStub(
            connect_to(arguments.predictor, arguments))
        request = predict_pb2.PredictRequest(
            width=mask.shape[1], height=mask.shape[0], image=radiance.astype("<f4").tobytes(),
            mask=mask.astype("<f4").tobytes())
        answer = calling("predictor", arguments.predictor,
                         lambda: predictor.Predict(request, timeout=60))
        material = answer.materials[0]
        result["prediction"] = {"sigma_t": material.sigma_t, "albedo": material.albedo,
                                "g": material.g}
    print(json.dumps(result, indent=2))
    return 0 if all(row.get("agrees", True) for row in result.values()) else 1


def main():
    arguments = parse_arguments()
    try:
        with tempfile.TemporaryDirectory(prefix="itn-proto-") as folder:
            return run(arguments, folder)
    except Failure as failure:
        print("itn_client.py:", " ".join(str(failure).split()), file=sys.stderr)
        return failure.code
    except KeyboardInterrupt:
        print("itn_client.py: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
