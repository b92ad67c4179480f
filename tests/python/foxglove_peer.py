"""What Foxglove would see, told as JSON; written against nothing of ours: `mcap` reads files, `websockets` speaks to the live
server, and every schema is compared with the definitions that Foxglove publishes (`foxglove-schemas-protobuf`).

    python foxglove_peer.py file LOG.mcap
    python foxglove_peer.py live ws://127.0.0.1:8765 --poses 40 --scenes 3
    python foxglove_peer.py slow ws://127.0.0.1:8765 --topic /drone/scene --times 200
    python foxglove_peer.py wrong ws://127.0.0.1:8765
"""

import argparse
import asyncio
import base64
import importlib
import json
import struct
import sys
from collections import defaultdict

from google.protobuf import descriptor_pb2, message_factory
from google.protobuf.descriptor_pool import DescriptorPool
from mcap.reader import make_reader
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

PROTOCOL = "foxglove.sdk.v1"


def fields(message):
    """What a message is on the wire and to a reader: names, numbers and types of its fields, and its enumerations."""
    own = {(f.name, f.number, f.type, f.label, f.type_name) for f in message.field}
    enums = {(e.name, v.name, v.number) for e in message.enum_type for v in e.value}
    return own, enums


def official(name):
    """Foxglove's own definition of a message."""
    module = importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2")
    file = descriptor_pb2.FileDescriptorProto()
    module.DESCRIPTOR.CopyToProto(file)
    return next(message for message in file.message_type if message.name == name)


def check_schema(data, wanted):
    """Parses the descriptors of a channel; the class of its messages. All that Foxglove defines must be as it defines it."""
    files = descriptor_pb2.FileDescriptorSet.FromString(data)
    pool, compared = DescriptorPool(), set()
    for file in files.file:
        pool.Add(file)
        if file.package == "foxglove":
            for message in file.message_type:
                assert fields(message) == fields(official(message.name)), message.name
                compared.add(f"{file.package}.{message.name}")
    assert wanted in compared, compared
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(wanted))


class Seen:
    """What came, by topic."""

    def __init__(self):
        self.topics = defaultdict(lambda: {"messages": 0, "ids": set(), "spheres": 0, "lines": 0, "poses": 0})

    def add(self, topic, schema, message, time_ns):
        seen = self.topics[topic]
        seen["schema"] = schema
        seen["messages"] += 1
        seen.setdefault("first_ns", time_ns)
        seen["last_ns"] = time_ns
        if schema == "foxglove.SceneUpdate":
            for entity in message.entities:
                seen["ids"].add(entity.id)
                seen["frame"] = entity.frame_id
                seen["spheres"] += len(entity.spheres)
                seen["lines"] += sum(len(line.points) for line in entity.lines)
                assert all(ball.size.x > 0 and ball.color.a > 0 for ball in entity.spheres)
                assert all(line.color.a > 0 or len(line.colors) == len(line.points) for line in entity.lines)
        elif schema == "foxglove.PosesInFrame":
            seen["poses"] = max(seen["poses"], len(message.poses))
            seen["frame"] = message.frame_id
        elif schema == "foxglove.PoseInFrame":
            seen["position"] = [message.pose.position.x, message.pose.position.y, message.pose.position.z]
            seen["frame"] = message.frame_id
        elif schema == "foxglove.FrameTransform":
            seen["frame"], seen["child"] = message.parent_frame_id, message.child_frame_id
        elif schema == "foxglove.CompressedImage":
            seen["format"], seen["bytes"] = message.format, len(message.data)

    def told(self):
        return {topic: {**seen, "ids": sorted(seen["ids"])} for topic, seen in self.topics.items()}


def read_file(path):
    seen, classes = Seen(), {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema.encoding == "protobuf" and channel.message_encoding == "protobuf"
            if not schema.name.startswith("foxglove."):
                seen.topics[channel.topic]["messages"] += 1
                continue
            if schema.id not in classes:
                classes[schema.id] = check_schema(schema.data, schema.name)
            seen.add(channel.topic, schema.name, classes[schema.id].FromString(message.data), message.log_time)
    print(json.dumps(seen.told()))


class Live:
    """A connection to the live server."""

    def __init__(self, socket):
        self.socket, self.channels, self.classes = socket, {}, {}
        self.subscriptions, self.statuses, self.time_ns = {}, [], 0
        self.seen = Seen()

    async def take(self):
        """Takes one message; the topic of one with data."""
        data = await self.socket.recv()
        if isinstance(data, str):
            said = json.loads(data)
            if said["op"] == "advertise":
                for channel in said["channels"]:
                    assert channel["encoding"] == channel["schemaEncoding"] == "protobuf"
                    self.channels[channel["id"]] = channel
                    schema = base64.b64decode(channel["schema"], validate=True)
                    self.classes[channel["id"]] = check_schema(schema, channel["schemaName"])
            elif said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "status":
                self.statuses.append(said)
            return None
        if data[0] == 2:
            self.time_ns = struct.unpack("<Q", data[1:9])[0]
            return None
        assert data[0] == 1, data[:1]
        number, time_ns = struct.unpack("<IQ", data[1:13])
        channel = self.channels[self.subscriptions[number]]
        message = self.classes[channel["id"]].FromString(data[13:])
        self.seen.add(channel["topic"], channel["schemaName"], message, time_ns)
        return channel["topic"]

    async def subscribe(self, wanted):
        """Subscribes to channels by the numbers of the subscriptions."""
        self.subscriptions.update(wanted)
        some = [{"id": number, "channelId": channel} for number, channel in wanted.items()]
        await self.socket.send(json.dumps({"op": "subscribe", "subscriptions": some}))

    def count(self, ending):
        return sum(seen["messages"] for topic, seen in self.seen.topics.items() if topic.endswith(ending))


def opened(url, **more):
    return connect(url, subprotocols=[PROTOCOL], max_size=None, compression=None, **more)


async def live(url, poses, scenes):
    """Subscribes to everything, until as many poses and scenes have come."""
    async with opened(url) as socket:
        assert socket.subprotocol == PROTOCOL
        client = Live(socket)
        while client.count("/pose") < poses or client.count("/scene") < scenes or client.count("/path") < 1:
            await client.take()
            new = {1000 + c: c for c in client.channels if c not in client.subscriptions.values()}
            if new:
                await client.subscribe(new)
        assert client.info["op"] == "serverInfo" and client.info["capabilities"] == ["time"]
        await socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": list(client.subscriptions)}))
        print(json.dumps({"topics": client.seen.told(), "statuses": client.statuses, "time_ns": client.time_ns}))


async def slow(url, topic, times):
    """Subscribes many times over, and reads nothing until told to by a line; what the server says of that."""
    async with opened(url, max_queue=1) as socket:
        client = Live(socket)
        while not (found := [c for c in client.channels.values() if c["topic"] == topic]):
            await client.take()
        await client.subscribe({k: found[0]["id"] for k in range(times)})
        print("subscribed", flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
        while not client.statuses:
            await client.take()
        print(json.dumps(client.statuses))


async def refused(url, **how):
    """The status with which a connection is refused."""
    try:
        async with connect(url, **how):
            return None
    except InvalidStatus as error:
        return error.response.status_code


async def wrong(url):
    """What must be refused."""
    told = {
        "no protocol": await refused(url),
        "another protocol": await refused(url, subprotocols=["mqtt"]),
        "another origin": await refused(url, subprotocols=[PROTOCOL], origin="https://evil.example"),
        "Foxglove's page": await refused(url, subprotocols=[PROTOCOL], origin="https://app.foxglove.dev"),
    }
    async with opened(url) as socket:
        client = Live(socket)
        bad = ["no JSON", '{"op":"advertise","channels":[]}', '{"op":"subscribe","subscriptions":[{"id":1,"channelId":999}]}', b"data"]
        for request in bad:
            await socket.send(request)
        while len(client.statuses) < len(bad):
            await client.take()
        told["statuses"] = [status["message"] for status in client.statuses]
        assert all(status["level"] == 2 for status in client.statuses)
        try:
            # The other end may hang up before all of it is sent.
            await socket.send("x" * (1 << 20))
            while True:
                await client.take()
        except ConnectionClosed:
            told["a megabyte"] = "closed"
    print(json.dumps(told))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=["file", "live", "slow", "wrong"])
    parser.add_argument("where")
    parser.add_argument("--poses", type=int, default=20)
    parser.add_argument("--scenes", type=int, default=2)
    parser.add_argument("--topic", default="/drone/scene")
    parser.add_argument("--times", type=int, default=200)
    args = parser.parse_args()
    if args.what == "file":
        read_file(args.where)
    elif args.what == "live":
        asyncio.run(live(args.where, args.poses, args.scenes))
    elif args.what == "slow":
        asyncio.run(slow(args.where, args.topic, args.times))
    else:
        asyncio.run(wrong(args.where))


if __name__ == "__main__":
    main()
