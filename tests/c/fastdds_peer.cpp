// A node on Fast DDS that subscribes to the odometry of examples/send_dds.py. It takes the type by its name and reads the serialized message itself,
// as a middleware of ROS 2 does.
//
//     fastdds_peer TOPIC COUNT      prints "ready", then a JSON array with the messages
//
// Fast DDS 2 (Debian 12: libfastrtps-dev): c++ -std=c++14 fastdds_peer.cpp -lfastrtps -lfastcdr

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <functional>

#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

namespace {

const auto PATIENCE = std::chrono::seconds(30);
const unsigned COVARIANCE = 36;

struct Odometry {
    int32_t sec;
    uint32_t nanosec;
    std::string frame_id, child_frame_id;
    double pose[7], pose_covariance[COVARIANCE], twist[6], twist_covariance[COVARIANCE];
};

// The type of ROS 2, read from its bytes.
class OdometryType : public TopicDataType {
public:
    OdometryType() {
        setName("nav_msgs::msg::dds_::Odometry_");
        m_typeSize = 2048;
        m_isGetKeyDefined = false;
        auto_fill_type_information(false);
        auto_fill_type_object(false);
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        auto& o = *static_cast<Odometry*>(data);
        FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
        Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
        cdr.read_encapsulation();
        cdr >> o.sec >> o.nanosec >> o.frame_id >> o.child_frame_id;
        cdr.deserializeArray(o.pose, 7).deserializeArray(o.pose_covariance, COVARIANCE);
        cdr.deserializeArray(o.twist, 6).deserializeArray(o.twist_covariance, COVARIANCE);
        return true;
    }
    bool serialize(void*, SerializedPayload_t*) override { return false; }
    std::function<uint32_t()> getSerializedSizeProvider(void*) override { return [this] { return m_typeSize; }; }
    void* createData() override { return new Odometry(); }
    void deleteData(void* data) override { delete static_cast<Odometry*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

}  // namespace

static void print(const char* name, const double* values, unsigned count, const char* end) {
    std::printf("\"%s\":[", name);
    for (unsigned k = 0; k < count; ++k) std::printf("%s%.17g", k ? "," : "", values[k]);
    std::printf("]%s", end);
}

static void print(const Odometry& o) {
    std::printf("{\"stamp_ns\":%lld,", o.sec * 1000000000LL + o.nanosec);
    std::printf("\"frames\":[\"%s\",\"%s\"],", o.frame_id.c_str(), o.child_frame_id.c_str());
    print("position", o.pose, 3, ",");
    print("orientation", o.pose + 3, 4, ",");
    print("covariance", o.pose_covariance, COVARIANCE, ",");
    print("linear", o.twist, 3, ",");
    print("twist_covariance", o.twist_covariance, COVARIANCE, "}");
}

int main(int argc, char** argv) {
    if (argc != 3) return 2;
    auto* factory = DomainParticipantFactory::get_instance();
    auto* participant = factory->create_participant(0, PARTICIPANT_QOS_DEFAULT);
    TypeSupport type(new OdometryType());
    type.register_type(participant);
    auto* topic = participant->create_topic(std::string("rt") + argv[1], type.get_type_name(), TOPIC_QOS_DEFAULT);
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.history().depth = 1000;
    auto* reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, qos);
    std::puts("ready");
    std::fflush(stdout);
    const int count = std::atoi(argv[2]);
    const auto end = std::chrono::steady_clock::now() + PATIENCE;
    std::printf("[");
    for (int seen = 0; seen < count && std::chrono::steady_clock::now() < end;) {
        Odometry o;
        SampleInfo info;
        if (reader->take_next_sample(&o, &info) != ReturnCode_t::RETCODE_OK) {
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
        } else if (info.valid_data) {
            if (seen++) std::printf(",");
            print(o);
        }
    }
    std::puts("]");
    std::fflush(stdout);
    std::_Exit(0);
}
