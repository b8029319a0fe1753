// Reads messages with OpenIGTLink's own library and prints them: igtl_reader HOST PORT COUNT.
#include <cstdio>
#include <cstdlib>

#include <igtlClientSocket.h>
#include <igtlMessageHeader.h>
#include <igtlPointMessage.h>
#include <igtlStringMessage.h>
#include <igtlTransformMessage.h>

template <typename Message>
bool Receive(igtl::ClientSocket* socket, igtl::MessageHeader* header, Message* message) {
  message->SetMessageHeader(header);
  message->AllocatePack();
  bool timed_out = false;
  socket->Receive(message->GetPackBodyPointer(), message->GetPackBodySize(), timed_out);
  return (message->Unpack(1) & igtl::MessageHeader::UNPACK_BODY) != 0;  // 1: check the CRC
}

int main(int count, char** words) {
  if (count != 4) return 2;
  igtl::ClientSocket::Pointer socket = igtl::ClientSocket::New();
  if (socket->ConnectToServer(words[1], std::atoi(words[2])) != 0) return 3;
  for (int left = std::atoi(words[3]); left > 0; --left) {
    igtl::MessageHeader::Pointer header = igtl::MessageHeader::New();
    header->InitPack();
    bool timed_out = false;
    if (socket->Receive(header->GetPackPointer(), header->GetPackSize(), timed_out) <= 0) return 0;
    header->Unpack();
    igtl::TimeStamp::Pointer stamp = igtl::TimeStamp::New();
    header->GetTimeStamp(stamp);
    std::printf("%s %s %.6f", header->GetDeviceType(), header->GetDeviceName(),
                stamp->GetTimeStamp());
    const std::string type = header->GetDeviceType();
    if (type == "TRANSFORM") {
      igtl::TransformMessage::Pointer message = igtl::TransformMessage::New();
      if (!Receive(socket.GetPointer(), header.GetPointer(), message.GetPointer())) return 4;
      igtl::Matrix4x4 matrix;
      message->GetMatrix(matrix);
      for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 4; ++column) std::printf(" %.9g", matrix[row][column]);
    } else if (type == "POINT") {
      igtl::PointMessage::Pointer message = igtl::PointMessage::New();
      if (!Receive(socket.GetPointer(), header.GetPointer(), message.GetPointer())) return 4;
      for (int number = 0; number < message->GetNumberOfPointElement(); ++number) {
        igtl::PointElement::Pointer point;
        message->GetPointElement(number, point);
        igtlFloat32 at[3];
        point->GetPosition(at);
        std::printf(" %.9g %.9g %.9g", at[0], at[1], at[2]);
      }
    } else if (type == "STRING") {
      igtl::StringMessage::Pointer message = igtl::StringMessage::New();
      if (!Receive(socket.GetPointer(), header.GetPointer(), message.GetPointer())) return 4;
      std::printf(" %s", message->GetString());
    } else {
      return 5;
    }
    std::printf("\n");
  }
  return 0;
}
