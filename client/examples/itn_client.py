#!/usr/bin/python3
"""Renders, differentiates and predicts with nothing of itn but its .proto files, as a client in any language does.

    itn_client.py [--worker HOST:PORT] [--predictor HOST:PORT] [--proto DIR]
                  [--tls-ca FILE [--tls-cert FILE --tls-key FILE] [--tls-server-name NAME] [--token-file FILE]]

Python itself has the package itn (docs/python.md). This needs protoc with its gRPC plugin, grpcio, protobuf and numpy
(Debian: protobuf-compiler-grpc, python3-grpcio, python3-protobuf, python3-numpy). Prints as JSON means over the object
with their standard errors, and whether each derivative agrees with its finite difference. What fails is said in one
line, with the exit codes of docs/errors.md; 1 if a derivative does not agree.
"""
import argparse
import hashlib
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

try:
    import grpc
    import numpy as np
except ImportError as error:
    print(f"itn_client.py: {error}; Debian has python3-grpcio and python3-numpy", file=sys.stderr)
    sys.exit(4)

PROTO = pathlib.Path(__file__).resolve().parents[2] / "proto"
ESTIMATES = 8  # independent, so that their spread tells the error of their mean
VALUES = {"sigma_t": 30, "albedo": 0.8, "g": 0.3, "surface[0].reflectance": 0.5}
STEPS = {"albedo": 0.01, "surface[0].reflectance": 0.05}
# As common/rpc/status.cpp has them.
EXIT_CODES = {grpc.StatusCode.INVALID_ARGUMENT: 3, grpc.StatusCode.UNAVAILABLE: 5, grpc.StatusCode.UNAUTHENTICATED: 5,
              grpc.StatusCode.UNIMPLEMENTED: 5, grpc.StatusCode.DEADLINE_EXCEEDED: 5,
              grpc.StatusCode.RESOURCE_EXHAUSTED: 7, grpc.StatusCode.CANCELLED: 130}


class Failure(Exception):
    """An exit code, and what is wrong."""


def compile_protos(folder, target):
    """Turns the .proto files into Python modules, in the folder `target`."""
    plugin = shutil.which("grpc_python_plugin")
    if not plugin or not shutil.which("protoc"):
        raise Failure(4, "there is no protoc with grpc_python_plugin; Debian has protobuf-compiler-grpc")
    protos = [f"itn/v1/{name}.proto" for name in ("scene", "render", "predict")]
    if not (folder / protos[0]).is_file():
        raise Failure(4, f"--proto {folder}: there is no {protos[0]} in it")
    subprocess.run(["protoc", f"--plugin=protoc-gen-grpc={plugin}", f"-I{folder}", f"--python_out={target}",
                    f"--grpc_out={target}", *protos], check=True)
    sys.path.insert(0, target)


def cube_on_the_ground(pb):
    """A cube of 1 mm under sun and sky, its triangles sent inline."""
    corners = np.array([[x, y, z] for x in (-.5, .5) for y in (0, 1) for z in (-.5, .5)], "<f4")
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], "<u4")
    scene = pb.Scene()
    scene.object.mesh.triangles.positions = corners.tobytes()
    scene.object.mesh.triangles.indices = triangles.tobytes()
    ground = scene.surfaces.add()
    ground.rectangle.half_u.x, ground.rectangle.half_v.z = 20, -20
    scene.lights.add().sun_sky.sun_angular_radius_degrees = 18.75
    scene.camera.origin.y, scene.camera.origin.z = 9.28, -32.8
    scene.camera.target.y = 0.5
    scene.camera.fov_degrees = 2.5
    scene.film.width = scene.film.height = 32
    return scene.SerializeToString()


def render(worker, pb, scene, changed=None, derivatives=(), weights=None):
    """One call. The scene is named by its digest, and sent only if the worker asks for it.

    With weights, an image of them: instead of derivative images, the gradient of the sum over the pixels of weight
    times radiance.
    """
    values = {**VALUES, **(changed or {})}
    material = {name: values.pop(name) for name in ("sigma_t", "albedo", "g")}
    request = pb.RenderGradRequest(
        scene_digest=hashlib.sha256(scene).digest(), material=pb.Material(**material), spp=64 * ESTIMATES, seed=1,
        estimates=ESTIMATES, parameters=derivatives,
        values=[pb.NamedValue(name=name, value=value) for name, value in values.items()])
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
    # Eight estimates exceed five standard errors once in 600 times; the finite difference may be half a percent off.
    most = 5 * gap["standard error"] + 0.005 * abs(float(np.mean(differences)))
    return {"derivative": mean_and_error(derivatives), "finite difference": mean_and_error(differences),
            "agrees": bool(abs(gap["mean"]) <= most)}


def render_and_compare(worker, render_pb2, scene_pb2):
    """What is printed of the renders, and the image and mask of the first."""
    scene = cube_on_the_ground(scene_pb2)
    reply = render(worker, render_pb2, scene, derivatives=VALUES)
    mask = image(reply, reply.mask)
    on_object = mask > 0.5

    def of_estimates(answer, plane=lambda e: e.radiance):
        return np.array([image(answer, plane(e))[on_object].mean() for e in answer.estimates])

    def difference(name, step):  # with the same random numbers on both sides
        above, below = (of_estimates(render(worker, render_pb2, scene, {name: VALUES[name] + side * step}))
                        for side in (1, -1))
        return (above - below) / (2 * step)

    result = {"radiance": mean_and_error(of_estimates(reply))}
    derivatives = {name: of_estimates(reply, lambda e, k=k: e.derivatives[k]) for k, name in enumerate(VALUES)}
    for name, held in derivatives.items():
        result[f"d radiance / d {name}"] = (compared(held, difference(name, STEPS[name])) if name in STEPS
                                            else {"derivative": mean_and_error(held)})
    # The same without images: the mean over the object is a weighted sum of the pixels.
    gradient = render(worker, render_pb2, scene, derivatives=VALUES, weights=on_object / on_object.sum())
    numbers = np.array([e.gradient for e in gradient.estimates])
    agrees = bool(np.allclose(numbers, np.array(list(derivatives.values())).T, rtol=1e-3, atol=1e-5))
    result["gradient is that of the images"] = {"agrees": agrees}
    return result, np.mean([image(reply, e.radiance) for e in reply.estimates], axis=0), mask


def predict(predictor, pb, radiance, mask):
    answer = predictor.Predict(pb.PredictRequest(width=mask.shape[1], height=mask.shape[0],
                                                 image=radiance.astype("<f4").tobytes(),
                                                 mask=mask.astype("<f4").tobytes()), timeout=60)
    material = answer.materials[0]
    return {"sigma_t": material.sigma_t, "albedo": material.albedo, "g": material.g}


def calling(what, address, call, *arguments):
    """What `call` returns; a Failure that names the server where it does not answer as it should."""
    try:
        return call(*arguments)
    except grpc.RpcError as error:
        if error.code() == grpc.StatusCode.UNIMPLEMENTED:
            raise Failure(5, f"{address} is not a {what}; itn-{what} is one") from error
        raise Failure(EXIT_CODES.get(error.code(), 1), f"{what} {address}: {error.details()}") from error


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", metavar="HOST:PORT", default="127.0.0.1:50051")
    parser.add_argument("--predictor", metavar="HOST:PORT", help="to predict from the image (default: none)")
    for flag, what in {"--tls-ca": "certificate of the servers' authority: connections are by TLS",
                       "--tls-cert": "certificate of ours", "--tls-key": "its private key",
                       "--token-file": "secret that the servers want"}.items():
        parser.add_argument(flag, metavar="FILE", type=pathlib.Path, help=what)
    parser.add_argument("--tls-server-name", metavar="NAME", help="what certificates call the servers, if not so")
    parser.add_argument("--proto", metavar="DIR", type=pathlib.Path, default=PROTO, help="of itn/v1/*.proto")
    arguments = parser.parse_args()
    if not arguments.tls_ca and (arguments.tls_cert or arguments.tls_server_name or arguments.token_file):
        parser.error("--tls-cert, --tls-server-name and --token-file need --tls-ca")
    if bool(arguments.tls_cert) != bool(arguments.tls_key):
        parser.error("--tls-cert and --tls-key belong together")
    return arguments


def connect_to(address, arguments):
    """A channel: by TLS, with a certificate and a token of ours, as far as they are given."""
    if not arguments.tls_ca:
        return grpc.insecure_channel(address)
    files = [path and path.read_bytes() for path in (arguments.tls_ca, arguments.tls_key, arguments.tls_cert)]
    credentials = grpc.ssl_channel_credentials(*files)
    if arguments.token_file:
        token = grpc.access_token_call_credentials(arguments.token_file.read_text("ascii").split()[0])
        credentials = grpc.composite_channel_credentials(credentials, token)
    name = arguments.tls_server_name
    return grpc.secure_channel(address, credentials, [("grpc.ssl_target_name_override", name)] if name else [])


def run(arguments, folder_of_modules):
    compile_protos(arguments.proto, folder_of_modules)
    from itn.v1 import render_pb2, render_pb2_grpc, scene_pb2, predict_pb2, predict_pb2_grpc

    worker = render_pb2_grpc.RenderServiceStub(connect_to(arguments.worker, arguments))
    result, radiance, mask = calling("worker", arguments.worker, render_and_compare, worker, render_pb2, scene_pb2)
    if arguments.predictor:
        predictor = predict_pb2_grpc.PredictServiceStub(connect_to(arguments.predictor, arguments))
        result["prediction"] = calling("predictor", arguments.predictor, predict, predictor, predict_pb2, radiance, mask)
    print(json.dumps(result, indent=2))
    return 0 if all(row.get("agrees", True) for row in result.values()) else 1


def main():
    arguments = parse_arguments()
    try:
        with tempfile.TemporaryDirectory(prefix="itn-proto-") as folder:
            return run(arguments, folder)
    except (Failure, OSError, subprocess.CalledProcessError) as error:
        code, message = error.args if isinstance(error, Failure) else (4, error)
        print("itn_client.py:", " ".join(str(message).split()), file=sys.stderr)
        return code
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
