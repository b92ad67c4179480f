"""What a machine with ROS 2 and rmw_zenoh would see of a vehicle, told as JSON; written against nothing of ours.

It opens the router that `rmw_zenohd` is and a session configured as those of ROS nodes are, finds publishers by their
liveliness tokens as rmw_zenoh's graph cache does, subscribes to the key that a subscriber of such a topic has, and decodes the samples with `rosbags`. It prints `ready`, and a line of JSON when the vehicle has left.

    python ros_peer.py --listen tcp/127.0.0.1:7447 --domain 0 --seconds 60
"""

import argparse
import json
import queue
import struct
import sys
import time

import xxhash
import zenoh
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_JAZZY)
# Default quality of service of rmw_zenoh (qos.cpp), for what a token leaves out; times are infinite.
FOREVER = (9223372036, 854775807)
RELIABILITY, DURABILITY, HISTORY, DEPTH, LIVELINESS = 1, 2, 1, 42, 1


def session(mode, listen, connect):
    """A session with what rmw_zenoh's configuration files change."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("listen/endpoints", json.dumps(listen))
    config.insert_json5("connect/endpoints", json.dumps(connect))
    config.insert_json5("scouting/multicast/enabled", "false")
    # Routers of newer Zenoh no longer know it.
    config.insert_json5("routing/router/peers_failover_brokering", "false")
    if mode == "peer":
        config.insert_json5("scouting/gossip/target", '{router: ["router", "peer"], peer: ["router"]}')
        strategy = '{peer: {to_router: "always", to_peer: "greater-zid"}}'
        config.insert_json5("scouting/gossip/autoconnect_strategy", strategy)
    return zenoh.open(config)


def number(text, default):
    return int(text) if text else default


def parse_qos(text):
    """`keyexpr_to_qos` of liveliness_utils.cpp."""
    parts = text.split(":")
    if len(parts) < 6:
        raise ValueError(f"quality of service has {len(parts)} parts: {text}")
    history, depth = parts[2].split(",")
    times = [tuple(number(x, y) for x, y in zip(part.split(","), FOREVER, strict=True)) for part in parts[3:5]]
    liveliness, *lease = parts[5].split(",")
    return {
        "reliability": number(parts[0], RELIABILITY),
        "durability": number(parts[1], DURABILITY),
        "history": number(history, HISTORY),
        "depth": number(depth, DEPTH),
        "deadline": times[0],
        "lifespan": times[1],
        "liveliness": number(liveliness, LIVELINESS),
        "lease": tuple(number(x, y) for x, y in zip(lease, FOREVER, strict=True)),
    }


def gid_of(token):
    """The identifier that every ROS node computes for the endpoint of a token."""
    number = xxhash.xxh3_128_intdigest(token.encode())
    return (number & (2**64 - 1)).to_bytes(8, "little") + (number >> 64).to_bytes(8, "little")


def parse_token(key):
    """`Entity::make` of liveliness_utils.cpp."""
    parts = key.split("/")
    if len(parts) < 9 or not all(parts):
        raise ValueError(f"{len(parts)} parts, or empty ones: {key}")
    if parts[0] != "@ros2_lv" or parts[5] not in ("NN", "MP", "MS", "SS", "SC"):
        raise ValueError(f"no token: {key}")
    name = [part.replace("%", "/") for part in parts]
    entity = {
        "token": key,
        "domain": int(parts[1]),
        "session": parts[2],
        "node_id": parts[3],
        "id": parts[4],
        "kind": parts[5],
        "enclave": name[6],
        "namespace": name[7],
        "node": name[8],
        "gid": gid_of(key).hex(),
    }
    if parts[5] != "NN":
        entity |= {"topic": name[9], "type": name[10], "hash": name[11], "qos": parse_qos(parts[12])}
    return entity


def ros_name(dds_name):
    """`_demangle_if_ros_type` of graph_cache.cpp: `a::msg::dds_::B_` is `a/msg/B`."""
    namespace, _, rest = dds_name.partition("dds_::")
    if not rest.endswith("_"):
        raise ValueError(f"{dds_name} is no type of ROS")
    return namespace.replace("::", "/") + rest[:-1]


def subscriber_key(publisher):
    """The key of a subscriber of this topic: its own hash of the type, not that of the token."""
    name = ros_name(publisher["type"])
    hash_ = "TypeHashNotSupported" if publisher["hash"] == "TypeHashNotSupported" else TYPES.hash_rihs01(name)
    return f"{publisher['domain']}/{publisher['topic'].strip('/')}/{publisher['type']}/{hash_}"


def plain(message):
    """A decoded message as lists and dictionaries, bytes in hexadecimal."""
    if hasattr(message, "__msgtype__"):
        names = [name for name in message.__dataclass_fields__ if name != "__msgtype__"]
        return {name: plain(getattr(message, name)) for name in names}
    if isinstance(message, list):
        return [plain(element) for element in message]
    if hasattr(message, "tolist"):
        return message.tobytes().hex() if message.dtype == "uint8" else message.tolist()
    return message


def told(publisher, sample):
    """A sample as ROS would take it: attachment and message."""
    name = ros_name(publisher["type"])
    payload, attachment = sample.payload.to_bytes(), sample.attachment.to_bytes()
    sequence, source_ns, length = struct.unpack_from("<qqB", attachment)
    if len(attachment) != 17 + length:
        raise ValueError(f"attachment of {len(attachment)} bytes says {length}")
    message = TYPES.deserialize_cdr(payload, name)
    return {
        "topic": publisher["topic"],
        "type": name,
        "sequence": sequence,
        "source_ns": source_ns,
        "received_ns": time.time_ns(),
        "gid": attachment[17:].hex(),
        "encoding": str(sample.encoding),
        # The other way round rosbags must come to the very same bytes.
        "same_bytes": bytes(TYPES.serialize_cdr(message, name)) == payload,
        "message": plain(message),
    }


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--listen", required=True, help="where the router listens")
    arguments.add_argument("--domain", type=int, default=0, help="ROS_DOMAIN_ID")
    arguments.add_argument("--seconds", type=float, default=60.0, help="time until the vehicle must have left")
    arguments = arguments.parse_args()
    changes, samples, subscribers = queue.Queue(), [], []

    with (
        session("router", [arguments.listen], []),
        session("peer", ["tcp/localhost:0"], [arguments.listen]) as node,
        node.liveliness().declare_subscriber(f"@ros2_lv/{arguments.domain}/**", changes.put, history=True),
    ):
        print("ready", flush=True)
        present, seen = set(), []
        deadline = time.monotonic() + arguments.seconds
        while not seen or present:
            sample = changes.get(timeout=max(0.0, deadline - time.monotonic()))
            key = str(sample.key_expr)
            if sample.kind == zenoh.SampleKind.DELETE:
                present.discard(key)
                continue
            entity = parse_token(key)
            present.add(key)
            seen.append(entity)
            if entity["kind"] == "MP":
                take = lambda sample, entity=entity: samples.append(told(entity, sample))
                subscribers.append(node.declare_subscriber(subscriber_key(entity), take))
    types = {ros_name(entity["type"]) for entity in seen if entity["kind"] == "MP"}
    hashes = {
        store.name: {name: get_typestore(store).hash_rihs01(name) for name in types}
        for store in (Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED)
    }
    told_of = {"entities": seen, "samples": samples, "hashes": hashes}
    json.dump(told_of, sys.stdout)
    print()


if __name__ == "__main__":
    main()
