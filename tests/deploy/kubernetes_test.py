#!/usr/bin/env python3
"""The manifests of deploy/kubernetes agree with the published schemas of Kubernetes, the oldest and
the newest that kubernetes-validate (PyPI) carries, and with each other."""
import copy
import os
import pathlib
import re
import sys

try:
    import kubernetes_validate
    import yaml
except ImportError as error:
    print(f"skipped: {error} (PyPI: kubernetes-validate)")
    sys.exit(77)

SOURCE = pathlib.Path(os.environ["ITN_SOURCE"])
DRAIN_SECONDS = 30  # the default of --drain-seconds
STOP_SECONDS = 10  # that a server may take beyond it
MEMORY_UNITS = {"Mi": 1, "Gi": 1024}  # in MiB


def version():
    """Of itn."""
    cmake = (SOURCE / "CMakeLists.txt").read_text()
    return re.search(r"project\(itn VERSION (\S+)", cmake).group(1)


def flag(container, name, default=None):
    """The value of --name in the container's command line."""
    values = [a.split("=", 1)[1] for a in container["args"] if a.startswith(f"--{name}=")]
    return values[-1] if values else default


def complaints_of_deployment(deployment):
    """What Kubernetes would take, and would not work or not be safe."""
    pod = deployment["spec"]["template"]["spec"]
    container, *others = pod["containers"]
    (port,) = (port["containerPort"] for port in container["ports"])
    if not flag(container, "listen").endswith(f":{port}"):
        yield "--listen is not the container's port"
    for probe in ("readinessProbe", "livenessProbe"):
        if f"localhost:{port}" not in container[probe]["exec"]["command"]:
            yield f"{probe} asks another port"
    drain = float(flag(container, "drain-seconds", DRAIN_SECONDS))
    if pod["terminationGracePeriodSeconds"] < drain + STOP_SECONDS:
        yield "terminationGracePeriodSeconds is less than the server may take to stop"
    number, unit = re.fullmatch(r"(\d+)(\w+)", container["resources"]["limits"]["memory"]).groups()
    if int(flag(container, "max-memory-mb")) > 0.9 * int(number) * MEMORY_UNITS[unit]:
        yield "--max-memory-mb leaves less than a tenth of the memory limit free"
    if container["image"].rpartition(":")[2] != version():
        yield f"the image's tag is not the version, {version()}"
    wanted = {
        "runAsNonRoot": True,
        "readOnlyRootFilesystem": True,
        "allowPrivilegeEscalation": False,
        "capabilities": {"drop": ["ALL"]},
        "seccompProfile": {"type": "RuntimeDefault"},
    }
    for each in pod["containers"]:
        rights = {**pod["securityContext"], **each["securityContext"]}
        for name, value in wanted.items():
            if rights.get(name) != value:
                yield f"{name} of {each['name']} is not {value}"
    paths = {mount["mountPath"]: mount["name"] for mount in container["volumeMounts"]}
    folder = flag(container, "metrics-file").rpartition("/")[0]
    for other in others:
        (mount,) = other["volumeMounts"]
        if mount["name"] != paths.get(folder) or flag(other, "collector.textfile.directory") != mount["mountPath"]:
            yield f"{other['name']} does not see --metrics-file"
    mounted = set(paths.values())
    if mounted != {volume["name"] for volume in pod["volumes"]}:
        yield "volumes and what is mounted differ"


def selected(manifest):
    """The labels by which the manifest selects pods, and the ports that it names."""
    spec = manifest["spec"]
    if manifest["kind"] == "Service":
        return spec["selector"], [port["targetPort"] for port in spec["ports"]]
    if manifest["kind"] == "NetworkPolicy":
        ports = [port["port"] for rule in spec["ingress"] for port in rule["ports"]]
        return spec["podSelector"]["matchLabels"], ports
    return spec["selector"]["matchLabels"], []


def complaints_of_all(manifests):
    """What a manifest says of others that is not so."""
    deployments = {m["metadata"]["name"]: m for m in manifests if m["kind"] == "Deployment"}
    namespaces = {m["metadata"]["name"] for m in manifests if m["kind"] == "Namespace"}
    ports = {}
    for deployment in deployments.values():
        template = deployment["spec"]["template"]
        containers = template["spec"]["containers"]
        labels = frozenset(template["metadata"]["labels"].items())
        ports[labels] = {port["name"] for each in containers for port in each["ports"]}
    for manifest in manifests:
        kind, name = manifest["kind"], manifest["metadata"]["name"]
        if kind == "Namespace":
            continue
        if manifest["metadata"]["namespace"] not in namespaces:
            yield f"{kind} {name}: no such namespace"
        if kind == "HorizontalPodAutoscaler":
            if manifest["spec"]["scaleTargetRef"]["name"] not in deployments:
                yield f"{kind} {name}: scales what is not there"
            continue
        labels, named = selected(manifest)
        labels = frozenset(labels.items())
        if labels not in ports:
            yield f"{kind} {name}: selects no pods"
        elif not set(named) <= ports[labels]:
            yield f"{kind} {name}: names a port that the pods do not have"
        if kind == "Deployment":
            for complaint in complaints_of_deployment(manifest):
                yield f"{kind} {name}: {complaint}"


def complaints_of_schemas(manifests):
    versions = kubernetes_validate.utils.all_versions()
    for kubernetes in (versions[0], versions[-1]):
        for manifest in manifests:
            try:
                kubernetes_validate.validate(manifest, kubernetes, strict=True)
            except kubernetes_validate.ValidationError as error:
                where = ".".join(map(str, error.path))
                yield f"{manifest['kind']}: Kubernetes {kubernetes}: {where}: {error.message}"


def main():
    manifests = []
    for path in sorted((SOURCE / "deploy/kubernetes").glob("*.yaml")):
        manifests += yaml.safe_load_all(path.read_text())
    complaints = [*complaints_of_schemas(manifests), *complaints_of_all(manifests)]
    # Mistakes would have been found: a field that there is not, a label that no pod has.
    wrong = copy.deepcopy(manifests)
    deployment = next(m for m in wrong if m["kind"] == "Deployment")
    deployment["spec"]["template"]["spec"]["containers"][0]["imagePolicy"] = "Never"
    if not any("imagePolicy" in complaint for complaint in complaints_of_schemas(wrong)):
        complaints.append("the schemas take any field")
    deployment["spec"]["template"]["metadata"]["labels"]["app"] = "another"
    if not any("selects no pods" in complaint for complaint in complaints_of_all(wrong)):
        complaints.append("no selector is looked at")
    for complaint in complaints:
        print(f"FAILED: {complaint}", file=sys.stderr)
    versions = kubernetes_validate.utils.all_versions()
    print(f"{len(manifests)} manifests, Kubernetes {versions[0]} and {versions[-1]}")
    return 1 if complaints else 0


sys.exit(main())
