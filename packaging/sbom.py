"""The bill of materials of the command: every crate that is built into it, as CycloneDX 1.6 in JSON.

Usage: sbom.py TARGET FEATURES FILE; TARGET as rustc names it (x86_64-unknown-linux-gnu), FEATURES as cargo does ("" for none).
The same Cargo.lock gives the same bytes."""

import json
import subprocess
import sys
import tomllib
import uuid

PACKAGE = "inkling-printhead"


def metadata(target, features):
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--filter-platform", target, "--features", features]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


def built_in(nodes, root):
    """What `root` is made of, itself among it, and of each what it asks for: build scripts' crates, too, tests' not."""
    asks, rest = {}, [root]
    while rest:
        node = rest.pop()
        if node in asks:
            continue
        wanted = [of["pkg"] for of in nodes[node]["deps"] if any(kind["kind"] != "dev" for kind in of["dep_kinds"])]
        asks[node] = sorted(set(wanted))
        rest += wanted
    return asks


def purl(package):
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package, checksums):
    of = {
        "type": "library",
        "bom-ref": purl(package),
        "name": package["name"],
        "version": package["version"],
        "purl": purl(package),
    }
    if package["license"]:
        # some write the "or" of old: MIT/Apache-2.0
        of["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
    if package["description"]:
        of["description"] = " ".join(package["description"].split())
    if package["repository"]:
        of["externalReferences"] = [{"type": "vcs", "url": package["repository"]}]
    checksum = checksums.get((package["name"], package["version"]))
    if checksum:
        of["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    return of


def bill(target, features):
    known = metadata(target, features)
    packages = {package["id"]: package for package in known["packages"]}
    nodes = {node["id"]: node for node in known["resolve"]["nodes"]}
    root = next(of for of in packages if packages[of]["name"] == PACKAGE)
    with open(known["workspace_root"] + "/Cargo.lock", "rb") as lock:
        locked = tomllib.load(lock)["package"]
    checksums = {(of["name"], of["version"]): of.get("checksum") for of in locked}
    asks = built_in(nodes, root)
    itself = component(packages[root], checksums) | {"type": "application"}
    parts = sorted((component(packages[of], checksums) for of in asks if of != root), key=lambda of: of["bom-ref"])
    edges = [{"ref": purl(packages[of]), "dependsOn": [purl(packages[to]) for to in asks[of]]} for of in asks]
    about = {
        "component": itself,
        "properties": [{"name": "rust:target", "value": target}, {"name": "cargo:features", "value": features}],
    }
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": about,
        "components": parts,
        "dependencies": sorted(edges, key=lambda of: of["ref"]),
    }
    content = json.dumps(document, sort_keys=True)
    return document | {"serialNumber": uuid.uuid5(uuid.NAMESPACE_URL, content).urn}


if __name__ == "__main__":
    target, features, path = sys.argv[1:]
    document = bill(target, features)
    with open(path, "w") as file:
        json.dump(document, file, indent=1)
        file.write("\n")
    print(f"{path}: {len(document['components'])} crates")
