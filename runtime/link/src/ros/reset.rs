//! The services `reset` and `reset_hard`, as `rmw_zenoh` calls services: a query on the key of the service, with the request
//! as payload and number and identifier of the client attached. The response carries both back.

use super::cdr;
use super::interface::InterfaceType;
use super::messages::{TriggerService, TriggerServiceResponse};
use super::names::{Attachment, Endpoint, RosTopic};
use super::topic::Declaring;
use crate::net::commands::reset_words;
use crate::net::{CommandRelay, NetError, now_ns};
use plumbline_estimator::ResetKind;
use std::sync::Arc;
use tokio::sync::{mpsc, watch};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{Query, Queryable};

/// Requests that wait.
const MAX_REQUESTS: usize = 8;
/// Requests that a server is advised to hold (`rmw_qos_profile_services_default`).
const DEPTH: u32 = 10;
/// Names of the services.
const SERVICES: [(&str, ResetKind); 2] = [("reset", ResetKind::Soft), ("reset_hard", ResetKind::Hard)];

/// Channel of resets, with the permission to request them.
#[derive(Clone, Debug)]
pub struct Resets {
    /// Way of commands to the flight.
    pub commands: Arc<CommandRelay>,
    /// Newest count of resets.
    pub count: watch::Receiver<u32>,
    /// Reason why commands are refused, if they are.
    pub refusal: Option<String>,
}

/// The services, as long as they are offered.
pub struct ResetServices {
    _services: Vec<(Queryable<()>, LivelinessToken)>,
}

/// Request with its attachment.
struct Request {
    kind: ResetKind,
    attachment: Attachment,
    query: Query,
}

impl ResetServices {
    /// Declares the services and answers until they are dropped.
    ///
    /// # Errors
    /// When Zenoh refuses a key.
    pub async fn declare(declaring: &mut Declaring<'_>, resets: Resets) -> Result<Self, NetError> {
        let (requests, mut waiting) = mpsc::channel::<Request>(MAX_REQUESTS);
        let mut services = Vec::new();
        for (name, kind) in SERVICES {
            let name = declaring.node().qualified(name);
            let topic = RosTopic { name, interface: InterfaceType::of::<TriggerService>(), depth: DEPTH };
            let key = declaring.node().key(&topic);
            let (requests, own) = (requests.clone(), key.clone());
            let queryable = declaring
                .session()
                .declare_queryable(key.clone())
                .complete(true)
                .callback(move |query| take(kind, &own, query, &requests))
                .await
                .map_err(|error| NetError::Declare { key, message: error.to_string() })?;
            let (token, _) = declaring.token(Endpoint::Service, &topic).await?;
            services.push((queryable, token));
        }
        tokio::spawn(async move {
            while let Some(request) = waiting.recv().await {
                let response = resets.obey(request.kind).await;
                request.answer(&response).await;
            }
        });
        Ok(Self { _services: services })
    }
}

/// Puts a request into the queue. One that no client of `rmw_zenoh` would send, or for which there is no room, is refused.
fn take(kind: ResetKind, key: &str, query: Query, requests: &mpsc::Sender<Request>) {
    let attachment = query.attachment().and_then(|bytes| Attachment::decode(&bytes.to_bytes()));
    let refused = |query: &Query, reason: &str| drop(query.reply_err(reason).wait());
    if query.key_expr().as_str() != key {
        // A pattern may mean everything there is.
        return refused(&query, &format!("a command needs its exact key: {key}"));
    }
    let Some(attachment) = attachment else {
        return refused(
            &query,
            "no request of rmw_zenoh: number and identifier of the client are not attached",
        );
    };
    if let Err(error) = requests.try_send(Request { kind, attachment, query }) {
        let request = error.into_inner();
        refused(&request.query, "busy: ask again later");
    }
}

impl Resets {
    /// Carries out a reset.
    async fn obey(&self, kind: ResetKind) -> TriggerServiceResponse {
        let outcome = match &self.refusal {
            Some(refusal) => Err(refusal.clone()),
            None => self.commands.reset(kind, self.count.clone()).await,
        };
        match outcome {
            Ok(count) => {
                let message = format!("{} reset done; reset_counter is {count}", reset_words(kind));
                TriggerServiceResponse { success: true, message }
            }
            Err(message) => {
                tracing::warn!("reset refused: {message}");
                TriggerServiceResponse { success: false, message }
            }
        }
    }
}

impl Request {
    async fn answer(&self, response: &TriggerServiceResponse) {
        let Ok(bytes) = cdr::encode(response) else { return };
        let attachment = Attachment { source_ns: now_ns(), ..self.attachment };
        let key = self.query.key_expr().clone();
        let _ = self.query.reply(key, bytes).attachment(attachment.encode().as_slice()).await;
    }
}
