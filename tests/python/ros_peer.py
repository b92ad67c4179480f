"""What a machine with ROS 2 and rmw_zenoh would see of a vehicle, told as JSON; written against nothing of ours.

It opens the router that `rmw_zenohd` is and a session configured as those of ROS nodes are, finds publishers and
services by their liveliness tokens as rmw_zenoh's graph cache does, subscribes to the key that a subscriber of such a
topic has, and decodes the samples with `rosbags`. With `--call` it calls services of `std_srvs/srv/Trigger` as a client
does, one after the other, once odometry has come for a while. It prints `ready`, and a line of JSON when the vehicle has
left.

    python ros_peer.py --listen tcp/127.0.0.1:7447 --domain 0 --seconds 60 --call /drone/reset
"""

import argparse
import json
import queue
import struct
import sys
import threading
import time

import xxhash
import zenoh
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TRIGGER = "std_srvs/srv/Trigger"
# Samples of odometry before a service is called, and time between two calls.
BEFORE_CALL = 100
BETWEEN_CALLS_S = 1.5


def service_types(name, request, response):
    """Definitions of a service, which rosbags has no parser for: those that rosidl makes of a `.srv` file."""
    # A char of ROS is a uint8 (rosidl_adapter); rosbags hashes the old word.
    event_info = "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number\n"
    stand_in = name.replace("/srv/", "/msg/")
    parts = {
        "_Request": request,
        "_Response": response,
        "_Event": "service_msgs/ServiceEventInfo info\n"
        f"{stand_in}_Request[<=1] request\n{stand_in}_Response[<=1] response\n",
        "": f"{stand_in}_Request request_message\n{stand_in}_Response response_message\n{stand_in}_Event event_message\n",
    }
    types = get_types_from_msg(event_info, "service_msgs/msg/ServiceEventInfo")
    for suffix, text in parts.items():
        types |= get_types_from_msg(text, stand_in + suffix)

    def renamed(part):
        if isinstance(part, str):
            return part.replace(stand_in, name)
        return type(part)(map(renamed, part)) if isinstance(part, (tuple, list)) else part

    return {renamed(key): renamed(value) for key, value in types.items()}


def service_hash(name, request, response):
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(service_types(name, request, response))
    return store.hash_rihs01(name)


TYPES = get_typestore(Stores.ROS2_JAZZY)
# One whose hash is published, in docs/design.md of rmw_zenoh: this is how services are hashed.
ADD_TWO_INTS = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
if service_hash("example_interfaces/srv/AddTwoInts", "int64 a\nint64 b\n", "int64 sum\n") != ADD_TWO_INTS:
    raise ValueError("rosbags hashes a known service otherwise")
TRIGGER_PARTS = ("", "bool success\nstring message\n")
TRIGGER_HASH = service_hash(TRIGGER, *TRIGGER_PARTS)
SERVICES = get_typestore(Stores.ROS2_HUMBLE)
SERVICES.register(service_types(TRIGGER, *TRIGGER_PARTS))
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


def attachment_of(sequence, gid):
    return struct.pack("<qqB", sequence, time.time_ns(), len(gid)) + gid


def call(node, domain, service, sequence):
    """A call as `rmw_send_request` makes it, and the response as `rmw_take_response` reads it."""
    name = service["topic"]
    key = f"{domain}/{name.strip('/')}/{service['type']}/{service['hash']}"
    mangled = name.replace("/", "%")
    token = (
        f"@ros2_lv/{domain}/{node.zid()}/0/{sequence}/SC/%/%/caller/{mangled}/{service['type']}/{service['hash']}/::,10:,:,:,,"
    )
    gid = gid_of(token)
    request = bytes(SERVICES.serialize_cdr(SERVICES.types[f"{TRIGGER}_Request"](), f"{TRIGGER}_Request"))
    options = {
        "target": zenoh.QueryTarget.ALL_COMPLETE,
        "consolidation": zenoh.ConsolidationMode.NONE,
        "timeout": 10.0,
    }
    with node.liveliness().declare_token(token):
        attachment = attachment_of(sequence, gid)
        replies = list(node.get(key, payload=request, attachment=attachment, **options))
        # What no client sends: without an attachment, with a part of one, and with a pattern.
        strange = [
            *node.get(key, payload=request, **options),
            *node.get(key, payload=request, attachment=attachment[:20], **options),
            *node.get(
                f"{domain}/*/{name.rsplit('/', 1)[1]}/**",
                payload=request,
                attachment=attachment,
                **(options | {"target": zenoh.QueryTarget.ALL}),
            ),
        ]
    answers = []
    for sample in (reply.ok for reply in replies if reply.ok is not None):
        number, source_ns, length = struct.unpack_from("<qqB", sample.attachment.to_bytes())
        payload = sample.payload.to_bytes()
        response = SERVICES.deserialize_cdr(payload, f"{TRIGGER}_Response")
        answers.append(
            {
                "key": str(sample.key_expr),
                "sequence": number,
                "is_ours": sample.attachment.to_bytes()[17:] == gid and length == len(gid),
                "delay_ms": (time.time_ns() - source_ns) * 1e-6,
                "same_bytes": bytes(SERVICES.serialize_cdr(response, f"{TRIGGER}_Response")) == payload,
                "response": plain(response),
            }
        )
    refused = [reply.err.payload.to_string() for reply in strange if reply.err is not None]
    return {"service": name, "key": key, "number": sequence, "answers": answers, "refused": refused}


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
    arguments.add_argument("--call", action="append", default=[], help="service to call")
    arguments = arguments.parse_args()
    changes, samples, subscribers, calls = queue.Queue(), [], [], []
    services = {}

    def call_all():
        """Calls the services in turn, each for itself, while samples come in."""
        while sum(sample["topic"].endswith("/odom") for sample in samples) < BEFORE_CALL:
            time.sleep(0.01)
        for sequence, name in enumerate(arguments.call, start=1):
            calls.append(call(node, arguments.domain, services[name], sequence))
            time.sleep(BETWEEN_CALLS_S)

    with (
        session("router", [arguments.listen], []),
        session("peer", ["tcp/localhost:0"], [arguments.listen]) as node,
        node.liveliness().declare_subscriber(f"@ros2_lv/{arguments.domain}/**", changes.put, history=True),
    ):
        print("ready", flush=True)
        caller = threading.Thread(target=call_all, daemon=True)
        if arguments.call:
            caller.start()
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
            if entity["kind"] == "SS":
                services[entity["topic"]] = entity
            if entity["kind"] == "MP":
                take = lambda sample, entity=entity: samples.append(told(entity, sample))
                subscribers.append(node.declare_subscriber(subscriber_key(entity), take))
    types = {ros_name(entity["type"]) for entity in seen if entity["kind"] == "MP"}
    hashes = {
        store.name: {name: get_typestore(store).hash_rihs01(name) for name in types}
        for store in (Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED)
    }
    # The same in every release that hashes.
    for of_release in hashes.values():
        of_release[TRIGGER] = TRIGGER_HASH
    told_of = {"entities": seen, "samples": samples, "hashes": hashes, "calls": calls}
    json.dump(told_of, sys.stdout)
    print()


if __name__ == "__main__":
    main()
